//! Figures of a stand, as foresters give them.

use crate::export::selection::SceneContent;
use crate::plants::Layer;
use crate::simulation::deadwood::snag::STUMP_M;
use crate::simulation::forest::LEAST_DBH_M;

/// Share of its density below which inventories take wood for soil. chosen: a tenth.
const LEAST_DENSITY_FRACTION: f32 = 0.1;
/// Stems a hectare whose mean height is the dominant height. As the field has it.
const DOMINANT_PER_HA: f64 = 100.0;
/// Stem that stand density is counted in, m. Reineke 1933: 25 cm (ten inches).
const REINEKE_DBH_M: f64 = 0.254;
/// Exponent of Reineke's law.
const REINEKE_EXPONENT: f64 = 1.605;

/// Figures of the living and the dead on a hectare.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stand {
    /// Ground, ha; masked cells left out.
    pub hectares: f64,
    /// Canopy trees a hectare.
    pub canopy_per_ha: f64,
    /// Live stems of [`LEAST_DBH_M`] and more a hectare.
    pub stems_per_ha: f64,
    /// Their basal area, m²/ha.
    pub basal_area_m2_ha: f64,
    /// Diameter of the stem of mean basal area, m.
    pub quadratic_mean_dbh_m: f64,
    /// Mean height of the hundred thickest stems a hectare, m.
    pub dominant_height_m: f64,
    /// Mean height weighed by basal area, m (Lorey's).
    pub lorey_height_m: f64,
    /// Stems of 25 cm a hectare that would be as crowded (Reineke 1933).
    pub stand_density_index: f64,
    /// Median of height over dbh of canopy trees, if there are any.
    pub slenderness: Option<f64>,
    /// Median of crown diameter over height of canopy trees, if there are any.
    pub crown_to_height: Option<f64>,
    /// Distance to the nearest canopy tree over that of trees strewn by chance (Clark & Evans 1954): 1 by chance, more is even;
    /// none with less than two.
    pub clark_evans: Option<f64>,
    /// Undergrowth plants a hectare.
    pub undergrowth_per_ha: f64,
    /// Basal area of snags, m²/ha, stumps left out.
    pub snag_basal_area_m2_ha: f64,
    /// Their share of standing basal area.
    pub snags_of_standing_fraction: f64,
    /// Volume that downed logs had when they came down, m³/ha; without those that are soil by now.
    pub downed_log_m3_ha: f64,
    /// Snags a hectare, stems of [`LEAST_DBH_M`] and more, stumps left out.
    pub snags_per_ha: f64,
}

impl Stand {
    /// Figures of a scene.
    pub fn of(scene: &SceneContent) -> Self {
        let (plants, frame) = (&scene.plants, scene.elevation_m.frame());
        let cell_m2 = f64::from(frame.cell_m()) * f64::from(frame.cell_m());
        let valid = scene.elevation_m.mask().as_slice().iter().filter(|valid| **valid).count();
        let hectares = valid as f64 * cell_m2 / 10_000.0;
        let canopy: Vec<usize> =
            (0..plants.len()).filter(|i| plants.layer[*i] == Layer::Canopy).collect();
        let mut stems: Vec<[f64; 2]> = (0..plants.len())
            .filter(|i| plants.dbh_m[*i] >= LEAST_DBH_M)
            .map(|i| [f64::from(plants.dbh_m[i]), f64::from(plants.height_m[i])])
            .collect();
        stems.sort_by(|a, b| b[0].total_cmp(&a[0]).then(b[1].total_cmp(&a[1])));
        let area_m2 = |dbh_m: f64| std::f64::consts::FRAC_PI_4 * dbh_m * dbh_m;
        let basal_m2: f64 = stems.iter().map(|[dbh, _]| area_m2(*dbh)).sum();
        let count = stems.len() as f64;
        let mean_square = stems.iter().map(|[dbh, _]| dbh * dbh).sum::<f64>() / count.max(1.0);
        let quadratic_mean_dbh_m = mean_square.sqrt();
        let dominant = ((DOMINANT_PER_HA * hectares).round() as usize).max(1).min(stems.len());
        let dominant_height_m = stems[..dominant].iter().map(|[_, height]| height).sum::<f64>()
            / dominant.max(1) as f64;
        let lorey = stems.iter().map(|[dbh, height]| area_m2(*dbh) * height).sum::<f64>();
        let thickness = quadratic_mean_dbh_m / REINEKE_DBH_M;
        let crowding = crate::math::powf_f64(thickness, REINEKE_EXPONENT);
        let ratios = |of: &dyn Fn(usize) -> [f32; 2]| {
            let ratio = |i: &usize| {
                let [a, b] = of(*i);
                (b > 0.0).then(|| f64::from(a / b))
            };
            median(canopy.iter().filter_map(ratio).collect())
        };
        let dead = scene.deadwood.as_ref();
        let snag_dbhs = || {
            dead.into_iter().flat_map(|dead| {
                let standing = dead.snags.dbh_m.iter().zip(&dead.snags.height_m);
                standing
                    .filter(|(dbh, height)| **dbh >= LEAST_DBH_M && **height > STUMP_M)
                    .map(|(dbh, _)| f64::from(*dbh))
            })
        };
        let snag_m2: f64 = snag_dbhs().map(area_m2).sum();
        let downed_m3 = dead.map_or(0.0, |dead| {
            let downed_logs = &dead.downed_logs;
            (0..downed_logs.len())
                .filter(|i| downed_logs.density_fraction[*i] >= LEAST_DENSITY_FRACTION)
                .map(|i| downed_logs.volume_m3(i))
                .sum()
        });
        let per_ha = |number: f64| number / hectares.max(1e-9);
        Self {
            hectares,
            canopy_per_ha: per_ha(canopy.len() as f64),
            stems_per_ha: per_ha(count),
            basal_area_m2_ha: per_ha(basal_m2),
            quadratic_mean_dbh_m,
            dominant_height_m,
            lorey_height_m: lorey / basal_m2.max(1e-9),
            stand_density_index: per_ha(count) * crowding,
            slenderness: ratios(&|i| [plants.height_m[i], plants.dbh_m[i]]),
            crown_to_height: ratios(&|i| [2.0 * plants.crown_radius_m[i], plants.height_m[i]]),
            clark_evans: clark_evans(scene, &canopy, hectares),
            undergrowth_per_ha: per_ha((plants.len() - canopy.len()) as f64),
            snag_basal_area_m2_ha: per_ha(snag_m2),
            snags_of_standing_fraction: snag_m2 / (snag_m2 + basal_m2).max(1e-9),
            downed_log_m3_ha: per_ha(downed_m3),
            snags_per_ha: per_ha(snag_dbhs().count() as f64),
        }
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Mean distance to the nearest neighbour over half the root of the mean ground a tree has.
///
/// # Reference
/// Clark & Evans 1954, doi:10.2307/1931034, without a correction for the rim.
fn clark_evans(scene: &SceneContent, canopy: &[usize], hectares: f64) -> Option<f64> {
    if canopy.len() < 2 {
        return None;
    }
    let plants = &scene.plants;
    let mean_m = 100.0 * (hectares / canopy.len() as f64).sqrt();
    // a bucket has a tree on average; neighbours lie within a few rings of buckets
    let bucket = |at_m: f32| (f64::from(at_m) / mean_m).max(0.0) as usize;
    let rows = canopy.iter().map(|i| bucket(plants.north_m[*i])).max().unwrap_or(0) + 1;
    let cols = canopy.iter().map(|i| bucket(plants.east_m[*i])).max().unwrap_or(0) + 1;
    let mut buckets: Vec<Vec<usize>> = vec![Vec::new(); rows * cols];
    for i in canopy {
        buckets[bucket(plants.north_m[*i]) * cols + bucket(plants.east_m[*i])].push(*i);
    }
    let nearest_m = |i: usize| {
        let (row, col) = (bucket(plants.north_m[i]), bucket(plants.east_m[i]));
        let mut least = f64::INFINITY;
        for ring in 1..rows.max(cols) + 1 {
            for row in row.saturating_sub(ring)..(row + ring + 1).min(rows) {
                for col in col.saturating_sub(ring)..(col + ring + 1).min(cols) {
                    for other in buckets[row * cols + col].iter().filter(|other| **other != i) {
                        let east = f64::from(plants.east_m[*other] - plants.east_m[i]);
                        let north = f64::from(plants.north_m[*other] - plants.north_m[i]);
                        least = least.min((east * east + north * north).sqrt());
                    }
                }
            }
            if least <= ring as f64 * mean_m {
                break;
            }
        }
        least
    };
    let sum: f64 = canopy.iter().map(|i| nearest_m(*i)).filter(|m| m.is_finite()).sum();
    Some(sum / canopy.len() as f64 / (0.5 * mean_m))
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::plants::Plants;
    use crate::raster::Grid;
    use crate::species::Biome;

    /// A hectare of level ground with firs on a lattice, `side` × `side`, of these measures.
    pub fn lattice(side: usize, height_m: f32, dbh_m: f32) -> SceneContent {
        let biome = Biome::builtin("pyrenees").unwrap();
        let fir = biome.species_index("silver-fir").unwrap() as u16;
        let mut plants = Plants::default();
        for i in 0..side * side {
            let step_m = 100.0 / side as f32;
            plants.id.push(i as u64);
            plants.species.push(fir);
            plants.layer.push(Layer::Canopy);
            plants.east_m.push(((i % side) as f32 + 0.5) * step_m);
            plants.north_m.push(((i / side) as f32 + 0.5) * step_m);
            plants.z_m.push(50.0);
            plants.height_m.push(height_m);
            plants.crown_radius_m.push(2.0);
            plants.dbh_m.push(dbh_m);
            plants.age_years.push(80.0);
            plants.vigor.push(1.0);
        }
        SceneContent {
            name: "lattice".to_owned(),
            biome,
            elevation_m: Grid::from_fn(50, 50, 2.0, |_| 50.0),
            plants,
            deadwood: None,
            years: 0,
        }
    }

    #[test]
    fn a_lattice_of_equal_trees_has_the_figures_of_one() {
        let stand = Stand::of(&lattice(20, 25.0, 0.3));
        let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-5, "{a} for {b}");
        near(stand.hectares, 1.0);
        near(stand.stems_per_ha, 400.0);
        near(stand.basal_area_m2_ha, 400.0 * std::f64::consts::FRAC_PI_4 * 0.09);
        near(stand.quadratic_mean_dbh_m, 0.3);
        near(stand.dominant_height_m, 25.0);
        near(stand.lorey_height_m, 25.0);
        near(stand.slenderness.unwrap(), 25.0 / 0.3);
        near(stand.crown_to_height.unwrap(), 4.0 / 25.0);
        // a square lattice is twice as even as chance
        near(stand.clark_evans.unwrap(), 2.0);
        // with no tree there is nothing to tell
        let bare = Stand::of(&lattice(0, 25.0, 0.3));
        assert_eq!((bare.slenderness, bare.crown_to_height, bare.clark_evans), (None, None, None));
        // 25.4 cm count as one each
        let stand = Stand::of(&lattice(20, 25.0, 0.254));
        assert!((stand.stand_density_index - 400.0).abs() < 0.1);
    }
}
