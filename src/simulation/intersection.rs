//! Competition by circles that may not meet, for comparison with competition for resources.
//!
//! # Reference
//! Deussen et al. 1998, "Realistic modeling and rendering of plant ecosystems", doi:10.1145/280814.280898; Kapp et al. 2020,
//! section 7.2 and Fig. 20.

use super::plot::Disk;
use crate::plants::buckets::Buckets;

/// Plants whose circle meets that of a taller one; of two as tall the one with the greater id.
pub fn dominated(disks: &[Disk], height_m: &[f32], id: &[u64]) -> Vec<bool> {
    let of = |measure: fn(&Disk) -> f32| disks.iter().map(measure).collect::<Vec<f32>>();
    let widest_m = disks.iter().map(|disk| disk.radius_m).fold(0.0, f32::max);
    let buckets = Buckets::new(&of(|d| d.east_m), &of(|d| d.south_m), widest_m.max(0.1));
    let is_taller = |a: usize, b: usize| {
        height_m[a] > height_m[b] || (height_m[a] == height_m[b] && id[a] < id[b])
    };
    let is_dominated = |plant: usize| {
        let disk = &disks[plant];
        let mut is_dominated = false;
        buckets.near([disk.east_m, disk.south_m], disk.radius_m + widest_m, |index| {
            let other = &disks[index];
            let (east_m, south_m) = (other.east_m - disk.east_m, other.south_m - disk.south_m);
            let reach_m = disk.radius_m + other.radius_m;
            is_dominated |= index != plant
                && east_m * east_m + south_m * south_m < reach_m * reach_m
                && is_taller(index, plant);
        });
        is_dominated
    };
    (0..disks.len()).map(is_dominated).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lower_of_two_that_meet_is_dominated() {
        let disk = |east_m: f32, radius_m: f32| Disk { east_m, south_m: 3.0, radius_m };
        let disks = [disk(1.0, 0.5), disk(1.8, 0.4), disk(2.5, 0.2), disk(9.0, 0.2)];
        assert_eq!(
            dominated(&disks, &[1.0, 0.8, 2.0, 0.1], &[1, 2, 3, 4]),
            [false, true, false, false]
        );
        assert_eq!(dominated(&disks, &[1.0; 4], &[2, 1, 3, 4]), [true, false, false, false]);
    }
}
