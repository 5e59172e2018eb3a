//! Instances: every plant, snag and downed log as an archetype, a place, a turn and a size. What 3D formats are written from.

use rayon::prelude::*;

use crate::math;
use crate::plants::deadwood::{DownedLogKind, DownedLogs, Snags};
use crate::plants::{Layer, Plants};
use crate::raster::Grid;
use crate::raster::resample::{CellPosition, Samples};
use crate::rng::{self, Key, Process};
use crate::species::Biome;
use crate::tree::archetype::Archetype;
use crate::tree::atlas::{Atlas, DownedLogMeasures, Fitting, PlantMeasures, SnagMeasures};
use crate::tree::downed_logs::AXIS_ABOVE_GROUND;
use crate::tree::low_poly::LowPolyAtlas;

/// The table that a row is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FeatureTable {
    /// Live plants.
    Plants,
    /// Snags.
    Snags,
    /// Downed logs.
    DownedLogs,
}

impl FeatureTable {
    /// The table's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plants => "plants",
            Self::Snags => "snags",
            Self::DownedLogs => "downed_logs",
        }
    }
}

/// All instances of an archetype: one entry of each array an instance, in the order of the table's rows.
#[derive(Clone, Debug, PartialEq)]
pub struct InstanceGroup {
    /// Index into [`Instances::archetypes`].
    pub archetype: usize,
    /// The table that `row` counts in.
    pub table: FeatureTable,
    /// Row of the feature in its table.
    pub row: Vec<u32>,
    /// Metres east, north and up from [`Instances::origin`].
    pub position_m: Vec<[f32; 3]>,
    /// Turn, a unit quaternion x, y, z, w.
    pub rotation: Vec<[f32; 4]>,
    /// Factors of the archetype's x, y and z, before the turn.
    pub scale: Vec<[f32; 3]>,
    /// What the colours of its materials are multiplied with, sRGB; 255 leaves them as they are.
    pub tint_srgb: Vec<[u8; 3]>,
}

/// A forest as instances.
#[derive(Clone, Debug, Default)]
pub struct Instances {
    /// Map coordinates and elevation that positions count from.
    pub origin: [f64; 3],
    /// Models.
    pub archetypes: Vec<Archetype>,
    /// Who stands where, at most one group an archetype and table.
    pub groups: Vec<InstanceGroup>,
}

/// Side of the squares that crowding is told by, m. chosen: some crowns wide.
const CROWDING_CELL_M: f32 = 10.0;
/// Least height of what crowds others, m.
const CROWDING_LEAST_M: f32 = 3.0;
/// Share of the ground under other crowns from which a tree counts as grown among others. chosen: closed stands have 0.7 and more.
const CROWDED_COVER_FRACTION: f32 = 0.7;
/// How much darker the darkest plants of a species are than the palest, as a share.
const BRIGHTNESS_SPREAD: f32 = 0.16;

/// An instance before it is sorted into its group.
#[derive(Clone, Copy, Debug)]
struct Placed {
    model: u32,
    position_m: [f32; 3],
    rotation: [f32; 4],
    scale: [f32; 3],
    tint_srgb: [u8; 3],
}

/// Where things stand: the ground, and the corner and origin that places count from.
struct Site<'a> {
    samples: Samples<'a>,
    rows: usize,
    cell_m: f64,
    shift_m: [f64; 3],
}

impl<'a> Site<'a> {
    fn new(ground: &'a Grid<f32>, origin: [f64; 3]) -> Self {
        let frame = ground.frame();
        let corner = frame.south_west();
        Self {
            samples: Samples::new(
                frame.rows,
                frame.cols,
                ground.values(),
                ground.mask().as_slice(),
            ),
            rows: frame.rows,
            cell_m: frame.transform.cell_m,
            shift_m: [corner.east_m - origin[0], corner.north_m - origin[1], -origin[2]],
        }
    }

    /// Elevation between cell centres, which surfaces through them have too.
    fn ground_m(&self, east_m: f32, north_m: f32) -> Option<f32> {
        let row = self.rows as f64 - f64::from(north_m) / self.cell_m;
        self.samples.bilinear(CellPosition { row, col: f64::from(east_m) / self.cell_m })
    }

    /// Metres from the origin; nothing lies so far from it that f32 would not hold millimetres.
    fn position_m(&self, east_m: f32, north_m: f32, z_m: f32) -> [f32; 3] {
        let place = [east_m, north_m, z_m].map(f64::from);
        std::array::from_fn(|k| (place[k] + self.shift_m[k]) as f32)
    }
}

/// Numbers of an entity's own.
fn draws(id: u64) -> [u32; 4] {
    rng::words(Key { seed: 0, process: Process::ModelChoice, year: 0, month: 0, entity: id })
}

/// A turn around the vertical by a share of a whole one.
fn turn(share: f32) -> [f32; 4] {
    let half = std::f32::consts::PI * share;
    [0.0, 0.0, math::sin(half), math::cos(half)]
}

/// A colour's factor as a byte.
fn byte(factor: f32) -> u8 {
    (255.0 * factor).round().clamp(0.0, 255.0) as u8 // in range
}

/// Tint of a plant: by itself, yellower where it does poorly, fresher where it is young.
fn plant_tint(word: u32, vigor: f32, age_fraction: f32) -> [u8; 3] {
    let own = rng::unit_interval(word);
    let hue = rng::unit_interval(word.wrapping_mul(0x9E37_79B9)) - 0.5;
    let brightness = 1.0 - BRIGHTNESS_SPREAD * own - 0.06 * age_fraction.clamp(0.0, 1.0);
    let poor = (0.5 - vigor).clamp(0.0, 0.5);
    let warm = 0.10 * hue + 0.16 * poor;
    [
        byte(brightness * (0.95 + warm)),
        byte(brightness * (0.97 - 0.10 * poor)),
        byte(brightness * (0.95 - warm - 0.2 * poor)),
    ]
}

/// Tint of dead wood.
fn wood_tint(word: u32) -> [u8; 3] {
    let own = rng::unit_interval(word);
    let hue = rng::unit_interval(word.wrapping_mul(0x9E37_79B9)) - 0.5;
    let brightness = 1.0 - BRIGHTNESS_SPREAD * own;
    [0.97 + 0.05 * hue, 0.97, 0.97 - 0.06 * hue].map(|factor| byte(brightness * factor))
}

/// Cover by crowns of trees, square by square, to tell how crowded each stands.
struct Crowding {
    cols: usize,
    rows: usize,
    crowns_m2: Vec<f32>,
}

impl Crowding {
    fn of(plants: &Plants, width_m: f64, height_m: f64) -> Self {
        let cells = |m: f64| (m / f64::from(CROWDING_CELL_M)).ceil().max(1.0) as usize; // a scene's
        let (rows, cols) = (cells(height_m), cells(width_m));
        let mut own = Self { cols, rows, crowns_m2: vec![0.0; rows * cols] };
        // one after the other: sums are the same for any number of threads
        for i in 0..plants.len() {
            if plants.height_m[i] >= CROWDING_LEAST_M {
                let cell = own.cell(plants.east_m[i], plants.north_m[i]);
                own.crowns_m2[cell] += crown_m2(plants.crown_radius_m[i]);
            }
        }
        own
    }

    fn cell(&self, east_m: f32, north_m: f32) -> usize {
        let of = |m: f32, count: usize| {
            ((m / CROWDING_CELL_M).max(0.0) as usize).min(count - 1) // within the squares
        };
        of(north_m, self.rows) * self.cols + of(east_m, self.cols)
    }

    /// How crowded a plant stands: the share of the ground under others' crowns, in the squares around it.
    fn fraction(&self, plants: &Plants, i: usize) -> f32 {
        let cell = self.cell(plants.east_m[i], plants.north_m[i]);
        let (row, col) = (cell / self.cols, cell % self.cols);
        let (mut crowns_m2, mut ground_m2) = (0.0, 0.0);
        for row in row.saturating_sub(1)..(row + 2).min(self.rows) {
            for col in col.saturating_sub(1)..(col + 2).min(self.cols) {
                crowns_m2 += self.crowns_m2[row * self.cols + col];
                ground_m2 += CROWDING_CELL_M * CROWDING_CELL_M;
            }
        }
        if plants.height_m[i] >= CROWDING_LEAST_M {
            crowns_m2 -= crown_m2(plants.crown_radius_m[i]);
        }
        // layers overlap: cover as if crowns were strewn at random
        let cover = 1.0 - math::exp(-(crowns_m2 / ground_m2).max(0.0));
        (cover / CROWDED_COVER_FRACTION).min(1.0)
    }
}

fn crown_m2(radius_m: f32) -> f32 {
    std::f32::consts::PI * radius_m * radius_m
}

/// Product of two turns: the second is done first.
fn turned(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    let [ax, ay, az, aw] = a;
    let [bx, by, bz, bw] = b;
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

impl Instances {
    /// Every plant, snag and downed log, as models of [`LowPolyAtlas`].
    ///
    /// `ground` holds elevations; positions count from `origin`, map coordinates and an elevation.
    ///
    /// ```
    /// use wildwood::export::instances::Instances;
    /// use wildwood::plants::deadwood::{DownedLogs, Snags};
    /// use wildwood::plants::{Layer, Plants};
    /// use wildwood::{raster::Grid, species::Biome};
    ///
    /// // a redwood on level ground of 40 m in local metres, whose south-west corner is 0, 0
    /// let biome = Biome::builtin("sonoma")?;
    /// let redwood = biome.species_index("redwood").ok_or("no redwood")?;
    /// let plants = Plants {
    ///     id: vec![1],
    ///     species: vec![redwood as u16],
    ///     layer: vec![Layer::Canopy],
    ///     east_m: vec![12.0],
    ///     north_m: vec![8.0],
    ///     z_m: vec![300.0],
    ///     height_m: vec![30.0],
    ///     crown_radius_m: vec![4.0],
    ///     dbh_m: vec![0.8],
    ///     age_years: vec![60.0],
    ///     vigor: vec![1.0],
    /// };
    /// let (snags, downed_logs) = (Snags::default(), DownedLogs::default());
    /// let ground = Grid::from_fn(20, 20, 2.0, |_| 300.0);
    /// let origin = [20.0, 20.0, 300.0];
    /// let forest = Instances::of(&plants, &snags, &downed_logs, &ground, &biome, origin);
    ///
    /// let group = &forest.groups[0];
    /// assert_eq!((group.row[0], group.position_m[0]), (0, [-8.0, -12.0, 0.0]));
    /// assert_eq!(usize::from(forest.archetypes[group.archetype].species), redwood);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn of(
        plants: &Plants,
        snags: &Snags,
        downed_logs: &DownedLogs,
        ground: &Grid<f32>,
        biome: &Biome,
        origin: [f64; 3],
    ) -> Self {
        let atlas = LowPolyAtlas::new(biome);
        Self::of_atlas(&atlas, plants, snags, downed_logs, ground, biome, origin)
    }

    /// Every plant, snag and downed log, as models of an atlas.
    pub fn of_atlas(
        atlas: &dyn Atlas,
        plants: &Plants,
        snags: &Snags,
        downed_logs: &DownedLogs,
        ground: &Grid<f32>,
        biome: &Biome,
        origin: [f64; 3],
    ) -> Self {
        let site = Site::new(ground, origin);
        let tables = [
            (FeatureTable::Plants, placed_plants(atlas, plants, &site, ground, biome)),
            (FeatureTable::Snags, placed_snags(atlas, snags, &site)),
            (FeatureTable::DownedLogs, placed_downed_logs(atlas, downed_logs, &site)),
        ];
        let is_used = {
            let mut used = vec![false; atlas.model_count()];
            for placed in tables.iter().flat_map(|(_, placed)| placed) {
                used[placed.model as usize] = true;
            }
            used
        };
        let models: Vec<u32> =
            (0..atlas.model_count() as u32).filter(|&m| is_used[m as usize]).collect();
        let archetypes = models.par_iter().map(|&model| atlas.archetype(model)).collect();
        let mut places = vec![0_u32; atlas.model_count()];
        for (place, &model) in (0..).zip(&models) {
            places[model as usize] = place;
        }
        let groups = tables
            .iter()
            .flat_map(|(table, placed)| grouped(*table, placed, &places, models.len()))
            .collect();
        Self { origin, archetypes, groups }
    }

    /// Number of instances.
    pub fn len(&self) -> usize {
        self.groups.iter().map(|group| group.row.len()).sum()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

fn placed_plants(
    atlas: &dyn Atlas,
    plants: &Plants,
    site: &Site<'_>,
    ground: &Grid<f32>,
    biome: &Biome,
) -> Vec<Placed> {
    let frame = ground.frame();
    let cell_m = frame.transform.cell_m;
    let crowding = Crowding::of(plants, frame.cols as f64 * cell_m, frame.rows as f64 * cell_m);
    let place = |i: usize| {
        let words = draws(plants.id[i]);
        let (east_m, north_m) = (plants.east_m[i], plants.north_m[i]);
        let is_tree = plants.layer[i] == Layer::Canopy || plants.height_m[i] >= CROWDING_LEAST_M;
        let Fitting { model, scale } = atlas.plant(&PlantMeasures {
            species: plants.species[i],
            height_m: plants.height_m[i],
            crown_radius_m: plants.crown_radius_m[i],
            dbh_m: plants.dbh_m[i],
            crowding_fraction: if is_tree { crowding.fraction(plants, i) } else { 1.0 },
            variety: words[0],
        });
        let age_fraction =
            plants.age_years[i] / biome.species[usize::from(plants.species[i])].max_age_years;
        let z_m = site.ground_m(east_m, north_m).unwrap_or(plants.z_m[i]);
        Placed {
            model,
            position_m: site.position_m(east_m, north_m, z_m),
            rotation: turn(rng::unit_interval(words[1])),
            scale,
            tint_srgb: plant_tint(words[2], plants.vigor[i], age_fraction),
        }
    };
    (0..plants.len()).into_par_iter().map(place).collect()
}

fn placed_snags(atlas: &dyn Atlas, snags: &Snags, site: &Site<'_>) -> Vec<Placed> {
    let place = |i: usize| {
        let words = draws(snags.id[i]);
        let (east_m, north_m) = (snags.east_m[i], snags.north_m[i]);
        let Fitting { model, scale } = atlas.snag(&SnagMeasures {
            species: snags.species[i],
            height_m: snags.height_m[i],
            height_at_death_m: snags.height_at_death_m[i],
            dbh_m: snags.dbh_m[i],
            decay_class: snags.decay_class[i],
            branch_fraction: snags.branch_fraction[i],
            variety: words[0],
        });
        let z_m = site.ground_m(east_m, north_m).unwrap_or(snags.z_m[i]);
        Placed {
            model,
            position_m: site.position_m(east_m, north_m, z_m),
            rotation: turn(rng::unit_interval(words[1])),
            scale,
            tint_srgb: wood_tint(words[2]),
        }
    };
    (0..snags.len()).into_par_iter().map(place).collect()
}

fn placed_downed_logs(atlas: &dyn Atlas, logs: &DownedLogs, site: &Site<'_>) -> Vec<Placed> {
    let place = |i: usize| {
        // ids of downed logs count anew
        let words = draws(logs.id[i] ^ 1 << 62);
        let (east_m, north_m) = (logs.east_m[i], logs.north_m[i]);
        let [end_east_m, end_north_m] = logs.thin_end_m(i);
        let class = usize::from(logs.decay_class[i].clamp(1, 5)) - 1;
        let above = |diameter_m: f32| AXIS_ABOVE_GROUND[class] * diameter_m;
        let thick_m = site.ground_m(east_m, north_m).unwrap_or(logs.z_m[i]);
        // a thin end outside the scene lies as high as the thick one
        let thin_m = site.ground_m(end_east_m, end_north_m).unwrap_or(thick_m);
        let from_m = thick_m + above(logs.diameter_base_m[i]);
        let to_m = thin_m + above(logs.diameter_tip_m[i]);
        let (run_m, rise_m) = (logs.length_m[i], to_m - from_m);
        let Fitting { model, scale } = atlas.downed_log(&DownedLogMeasures {
            species: logs.species[i],
            kind: logs.kind[i],
            length_m: (run_m * run_m + rise_m * rise_m).sqrt(),
            diameter_base_m: logs.diameter_base_m[i],
            diameter_tip_m: logs.diameter_tip_m[i],
            decay_class: logs.decay_class[i],
            variety: words[0],
        });
        // rotten ones are flat and root plates upright: those do not roll
        let rolls = class < 3 && logs.kind[i] != DownedLogKind::Uprooted;
        let roll = if rolls { turn(rng::unit_interval(words[1])) } else { turn(0.0) };
        let roll = [roll[2], 0.0, 0.0, roll[3]];
        // x turned to the azimuth, which counts from north clockwise
        let yaw = turn((0.25 - logs.azimuth_rad[i] / std::f32::consts::TAU).rem_euclid(1.0));
        let half = -0.5 * math::atan2(rise_m, run_m.max(1e-3));
        let pitch = [0.0, math::sin(half), 0.0, math::cos(half)];
        Placed {
            model,
            position_m: site.position_m(east_m, north_m, from_m),
            rotation: turned(yaw, turned(pitch, roll)),
            scale,
            tint_srgb: wood_tint(words[2]),
        }
    };
    (0..logs.len()).into_par_iter().map(place).collect()
}

/// Sorts a table's instances into groups, whose archetypes are at `places` by model.
fn grouped(
    table: FeatureTable,
    placed: &[Placed],
    places: &[u32],
    archetypes: usize,
) -> Vec<InstanceGroup> {
    let archetype = |p: &Placed| places[p.model as usize] as usize;
    let mut starts = vec![0_usize; archetypes + 1];
    for p in placed {
        starts[archetype(p) + 1] += 1;
    }
    for i in 0..archetypes {
        starts[i + 1] += starts[i];
    }
    let mut next = starts.clone();
    let mut rows = vec![0_u32; placed.len()];
    for (row, p) in (0..).zip(placed) {
        let slot = &mut next[archetype(p)];
        rows[*slot] = row;
        *slot += 1;
    }
    (0..archetypes)
        .into_par_iter()
        .filter(|&i| starts[i] < starts[i + 1])
        .map(|i| {
            let row = rows[starts[i]..starts[i + 1]].to_vec();
            let of = |r: &u32| &placed[*r as usize];
            InstanceGroup {
                archetype: i,
                table,
                position_m: row.par_iter().map(|r| of(r).position_m).collect(),
                rotation: row.par_iter().map(|r| of(r).rotation).collect(),
                scale: row.par_iter().map(|r| of(r).scale).collect(),
                tint_srgb: row.par_iter().map(|r| of(r).tint_srgb).collect(),
                row,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;
    use crate::plants::deadwood::Cause;

    /// Ground that rises by 0.3 a metre to the east.
    fn slope() -> Grid<f32> {
        Grid::from_fn(200, 200, 2.0, |cell| 500.0 + 0.3 * (2.0 * cell.col as f32 + 1.0))
    }

    fn sonoma() -> Biome {
        Biome::builtin("sonoma").unwrap()
    }

    /// Plants of all species and sizes, strewn over 400 m.
    fn plants(count: usize, biome: &Biome) -> Plants {
        let fraction = |i: usize, step: usize| (i * step % 65_521) as f32 / 65_521.0;
        let mut all = Plants::default();
        for i in 0..count {
            let index = i % biome.species.len();
            let species = &biome.species[index];
            let height_m = 0.1 + fraction(i, 37) * 0.8 * species.max_height_m;
            all.id.push(i as u64);
            all.species.push(index as u16);
            all.layer.push(if height_m > 5.0 { Layer::Canopy } else { Layer::Undergrowth });
            all.east_m.push(400.0 * fraction(i, 7919));
            all.north_m.push(400.0 * fraction(i, 104_729));
            all.z_m.push(500.0);
            all.height_m.push(height_m);
            all.crown_radius_m.push(species.crown_radius_m(height_m));
            all.dbh_m.push(species.dbh_m(height_m));
            all.age_years.push(50.0);
            all.vigor.push(fraction(i, 53));
        }
        all
    }

    fn snags(count: usize) -> Snags {
        let mut all = Snags::default();
        for i in 0..count {
            all.id.push(i as u64);
            all.species.push(9 + (i % 7) as u16);
            all.east_m.push(3.0 * i as f32);
            all.north_m.push(100.0);
            all.z_m.push(500.0);
            all.height_m.push([20.0, 12.0, 0.8][i % 3]);
            all.height_at_death_m.push(20.0);
            all.dbh_m.push(0.4);
            all.years_dead.push(5.0);
            all.decay_class.push(1 + (i % 5) as u8);
            all.density_fraction.push(0.8);
            all.branch_fraction.push(0.5);
            all.cause.push(Cause::Age);
        }
        all
    }

    fn downed_logs(count: usize) -> DownedLogs {
        let mut all = DownedLogs::default();
        for i in 0..count {
            all.id.push(i as u64);
            all.parent_id.push(i as u64);
            all.species.push((9 + i % 7) as u16);
            all.kind.push(DownedLogKind::ALL[i % 4]);
            all.east_m.push(100.0 + i as f32);
            all.north_m.push(150.0);
            all.z_m.push(500.0);
            all.length_m.push(15.0);
            all.diameter_base_m.push(0.5);
            all.diameter_tip_m.push(0.1);
            all.azimuth_rad.push(0.7 * i as f32 % std::f32::consts::TAU);
            all.years_down.push(1.0);
            all.decay_class.push(1 + (i % 5) as u8);
            all.density_fraction.push(0.8);
            all.cause.push(Cause::Storm);
        }
        all
    }

    fn forest(origin: [f64; 3]) -> Instances {
        let biome = sonoma();
        let (plants, snags, logs) = (plants(3000, &biome), snags(60), downed_logs(60));
        Instances::of(&plants, &snags, &logs, &slope(), &biome, origin)
    }

    /// Turns a direction.
    fn rotated(rotation: [f32; 4], v: [f32; 3]) -> [f32; 3] {
        let [x, y, z, w] = rotation;
        let inverse = [-x, -y, -z, w];
        let [a, b, c, _] = turned(turned(rotation, [v[0], v[1], v[2], 0.0]), inverse);
        [a, b, c]
    }

    #[test]
    fn everything_is_one_instance_in_its_true_size() {
        let biome = sonoma();
        let all = forest([0.0; 3]);
        assert_eq!(all.len(), 3120);
        let plants = plants(3000, &biome);
        let mut seen = vec![false; 3000];
        for group in &all.groups {
            let archetype = &all.archetypes[group.archetype];
            assert!(group.row.windows(2).all(|pair| pair[0] < pair[1]));
            for (i, &row) in group.row.iter().enumerate() {
                let long: f32 = group.rotation[i].iter().map(|v| v * v).sum();
                assert!((long - 1.0).abs() < 1e-5, "{}", archetype.key);
                if group.table == FeatureTable::Plants {
                    let row = row as usize;
                    assert!(!std::mem::replace(&mut seen[row], true));
                    assert_eq!(archetype.species, plants.species[row]);
                    let radius_m = plants.crown_radius_m[row];
                    assert_eq!(group.scale[i], [radius_m, radius_m, plants.height_m[row]]);
                    // upright on the slope
                    let up = rotated(group.rotation[i], [0.0, 0.0, 1.0]);
                    assert!((up[2] - 1.0).abs() < 1e-6);
                    let [x, y, z] = group.position_m[i];
                    assert_eq!([x, y], [plants.east_m[row], plants.north_m[row]]);
                    if (2.0..398.0).contains(&x) {
                        assert!((z - 500.0 - 0.3 * x).abs() < 1e-2, "{x}: {z}");
                    }
                }
            }
        }
        assert!(seen.into_iter().all(|s| s));
    }

    #[test]
    fn downed_logs_lie_on_the_slope_from_end_to_end() {
        let all = forest([0.0; 3]);
        let logs = downed_logs(60);
        let of_logs = |group: &&InstanceGroup| group.table == FeatureTable::DownedLogs;
        for group in all.groups.iter().filter(of_logs) {
            for (i, row) in group.row.iter().enumerate() {
                let row = *row as usize;
                let along = rotated(group.rotation[i], [1.0, 0.0, 0.0]);
                let end: [f32; 3] =
                    std::array::from_fn(|k| group.position_m[i][k] + group.scale[i][0] * along[k]);
                let [east_m, north_m] = logs.thin_end_m(row);
                let class = usize::from(logs.decay_class[row]) - 1;
                let z_m = 500.0 + 0.3 * east_m + 0.1 * AXIS_ABOVE_GROUND[class];
                for (found, expected) in end.into_iter().zip([east_m, north_m, z_m]) {
                    assert!((found - expected).abs() < 0.01, "{end:?}: {east_m} {north_m} {z_m}");
                }
            }
        }
    }

    #[test]
    fn positions_count_from_the_origin() {
        let (here, there) = (forest([0.0; 3]), forest([100.0, -20.0, 450.0]));
        let (a, b) = (here.groups[0].position_m[0], there.groups[0].position_m[0]);
        for (k, shift) in [100.0, -20.0, 450.0].into_iter().enumerate() {
            assert!((a[k] - b[k] - shift).abs() < 1e-3);
        }
    }

    #[test]
    fn same_instances_for_one_thread_and_two() {
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| forest([0.0; 3]).groups)
        };
        assert!(with(1) == with(2));
    }

    #[test]
    fn trees_among_others_are_told_from_those_alone() {
        let biome = sonoma();
        let oak = biome.species_index("tanoak").unwrap() as u16;
        let mut all = Plants::default();
        // a dense stand in the west, and one tree in the east
        let places = (0..400).map(|i| ((i % 20) as f32 * 4.0, (i / 20) as f32 * 4.0));
        for (i, (east_m, north_m)) in places.chain([(300.0, 300.0)]).enumerate() {
            all.id.push(i as u64);
            all.species.push(oak);
            all.layer.push(Layer::Canopy);
            all.east_m.push(east_m);
            all.north_m.push(north_m);
            all.z_m.push(500.0);
            all.height_m.push(20.0);
            all.crown_radius_m.push(3.0);
            all.dbh_m.push(0.3);
            all.age_years.push(80.0);
            all.vigor.push(0.8);
        }
        let none = (Snags::default(), DownedLogs::default());
        let instances = Instances::of(&all, &none.0, &none.1, &slope(), &biome, [0.0; 3]);
        for group in &instances.groups {
            let key = &instances.archetypes[group.archetype].key;
            for row in &group.row {
                let form = if *row == 400 { ".tree.open." } else { ".tree.forest." };
                // the stand's rim may count as either
                assert!(key.contains(form) || (*row < 400 && key.contains(".tree.")), "{key}");
            }
        }
        let forest: usize = instances
            .groups
            .iter()
            .filter(|g| instances.archetypes[g.archetype].key.contains(".tree.forest."))
            .map(|g| g.row.len())
            .sum();
        assert!(forest > 300, "{forest}");
    }

    #[test]
    #[ignore = "measures time: run alone, in release"]
    fn a_million_plants_take_a_third_of_a_second() {
        let biome = sonoma();
        let plants = plants(1_000_000, &biome);
        let (snags, logs) = (Snags::default(), DownedLogs::default());
        let begin = Instant::now();
        let all = Instances::of(&plants, &snags, &logs, &slope(), &biome, [0.0; 3]);
        let seconds = begin.elapsed().as_secs_f64();
        assert_eq!(all.len(), 1_000_000);
        assert!(seconds < 0.3, "{seconds} s for {} models", all.archetypes.len());
    }
}
