//! A small scene that 3D formats are tested with.

use super::instances::{FeatureTable, InstanceGroup, Instances};
use super::scene3d::Scene3d;
use super::terrain_mesh::TerrainMesh;
use crate::math;
use crate::plants::deadwood::{Cause, DownedLogKind, DownedLogs, Snags};
use crate::plants::{Layer, Plants};
use crate::raster::{Crs, Grid};
use crate::species::Biome;
use crate::tree::archetype::Archetype;
use crate::tree::mesh::{Material, Mesh, MeshPart};

/// Owns what a [`Scene3d`] borrows.
pub struct Example {
    pub crs: Crs,
    pub biome: Biome,
    pub terrain: TerrainMesh,
    pub instances: Instances,
    pub plants: Plants,
    pub snags: Snags,
    pub downed_logs: DownedLogs,
}

/// A side of the scene, metres.
pub const SIDE_M: f32 = 200.0;

/// A cone of radius `radius` from height `low` to `high`, closed below.
fn cone(material: Material, corners: u32, radius: f32, low: f32, high: f32) -> MeshPart {
    let mut part = MeshPart { material, positions: vec![], normals: vec![], triangles: vec![] };
    let ring = |corner: u32| {
        let angle_rad = std::f32::consts::TAU * corner as f32 / corners as f32;
        [math::cos(angle_rad), math::sin(angle_rad)]
    };
    for corner in 0..corners {
        let (a, b) = (ring(corner), ring(corner + 1));
        let rim = |p: [f32; 2]| [radius * p[0], radius * p[1], low];
        let first = part.positions.len() as u32;
        part.positions.extend([rim(a), rim(b), [0.0, 0.0, high], rim(b), rim(a), [0.0, 0.0, low]]);
        let slope = (radius * radius + (high - low) * (high - low)).sqrt();
        let out = |p: [f32; 2]| {
            [p[0] * (high - low) / slope, p[1] * (high - low) / slope, radius / slope]
        };
        part.normals.extend([
            out(a),
            out(b),
            out(a),
            [0.0, 0.0, -1.0],
            [0.0, 0.0, -1.0],
            [0.0, 0.0, -1.0],
        ]);
        part.triangles.extend([[first, first + 1, first + 2], [first + 3, first + 4, first + 5]]);
    }
    part
}

fn archetype(key: &str, species: u16, materials: [Material; 2]) -> Archetype {
    let level = |corners: u32| Mesh {
        parts: vec![
            cone(materials[0], corners, 0.2, 0.0, 0.5),
            cone(materials[1], corners, 1.0, 0.3, 1.0),
        ],
    };
    let colors_srgb = [[92, 76, 62], [60, 90, 50], [158, 142, 120], [84, 66, 48]];
    Archetype { key: key.to_owned(), species, levels: [level(12), level(6), level(3)], colors_srgb }
}

impl Example {
    /// So many plants, a tenth as many snags and downed logs, on a slope in California.
    pub fn new(plants: usize) -> Self {
        let origin = [256_000.0, 4_110_000.0, 350.0];
        let slope = Grid::from_fn(50, 50, 4.0, |cell| 350.0 + cell.col as f32 * 0.8);
        let terrain = TerrainMesh::new(&slope, [0.0, 0.0, 350.0], None, 2_000);
        let mut example = Self {
            crs: Crs::Epsg(32611),
            biome: Biome::builtin("sonoma").unwrap(),
            terrain,
            instances: Instances { origin, ..Instances::default() },
            plants: Plants::default(),
            snags: Snags::default(),
            downed_logs: DownedLogs::default(),
        };
        let live = [Material::Bark, Material::Foliage];
        example.instances.archetypes = vec![
            archetype("coast-live-oak.tree.forest.s0", 8, live),
            archetype("redwood.tree.open.s1", 14, live),
            archetype("redwood.snag.s0", 14, [Material::Wood, Material::Bark]),
            archetype("redwood.downed.s0", 14, [Material::Wood, Material::Soil]),
        ];
        let tables = [
            (0, FeatureTable::Plants),
            (1, FeatureTable::Plants),
            (2, FeatureTable::Snags),
            (3, FeatureTable::DownedLogs),
        ];
        example.instances.groups =
            tables.map(|(archetype, table)| empty(archetype, table)).to_vec();
        let dead = plants.div_ceil(10);
        (0..plants).for_each(|i| example.plant(i));
        (0..dead).for_each(|i| example.snag(i));
        (0..dead).for_each(|i| example.downed_log(i));
        example
    }

    /// As a writer takes it.
    pub fn scene(&self) -> Scene3d<'_> {
        Scene3d {
            name: "example",
            crs: &self.crs,
            biome: &self.biome,
            terrain: &self.terrain,
            instances: &self.instances,
            plants: &self.plants,
            snags: &self.snags,
            downed_logs: &self.downed_logs,
        }
    }

    /// Scattered over the scene, the same places for the same numbers.
    fn place(i: usize) -> [f32; 3] {
        let scatter = |factor: f32| (i as f32 * factor + 0.3).fract();
        let [x, y] = [scatter(0.618_034), scatter(0.754_878)].map(|share| share * SIDE_M);
        [x, y, 0.2 * x]
    }

    fn put(&mut self, group: usize, row: usize, place: [f32; 3], scale: [f32; 3], turn_rad: f32) {
        let group = &mut self.instances.groups[group];
        group.row.push(row as u32);
        group.position_m.push(place);
        group.rotation.push([0.0, 0.0, math::sin(turn_rad / 2.0), math::cos(turn_rad / 2.0)]);
        group.scale.push(scale);
        group.tint_srgb.push([200 + (row % 56) as u8, 255, 180]);
    }

    fn plant(&mut self, i: usize) {
        let place = Self::place(i);
        let height_m = 1.0 + (i % 30) as f32;
        let is_canopy = height_m > 12.0;
        let plants = &mut self.plants;
        plants.id.push(10_000_000_000 + i as u64);
        plants.species.push(if i.is_multiple_of(2) { 8 } else { 14 });
        plants.layer.push(if is_canopy { Layer::Canopy } else { Layer::Undergrowth });
        plants.east_m.push(place[0]);
        plants.north_m.push(place[1]);
        plants.z_m.push(350.0 + place[2]);
        plants.height_m.push(height_m);
        plants.crown_radius_m.push(0.2 * height_m);
        plants.dbh_m.push(0.01 * height_m);
        plants.age_years.push(3.5 * height_m);
        plants.vigor.push(0.5);
        let radius_m = 0.2 * height_m;
        self.put(i % 2, i, place, [radius_m, radius_m, height_m], i as f32);
    }

    fn snag(&mut self, i: usize) {
        let place = Self::place(i + 7_000);
        let snags = &mut self.snags;
        snags.id.push(i as u64);
        snags.species.push(14);
        snags.east_m.push(place[0]);
        snags.north_m.push(place[1]);
        snags.z_m.push(350.0 + place[2]);
        snags.height_m.push(8.0);
        snags.height_at_death_m.push(16.0);
        snags.dbh_m.push(0.3);
        snags.years_dead.push(12.5);
        snags.decay_class.push(3);
        snags.density_fraction.push(0.7);
        snags.branch_fraction.push(0.2);
        snags.cause.push(Cause::Storm);
        self.put(2, i, place, [0.5, 0.5, 8.0], 0.0);
    }

    fn downed_log(&mut self, i: usize) {
        let place = Self::place(i + 9_000);
        let downed = &mut self.downed_logs;
        downed.id.push(i as u64);
        downed.parent_id.push(i as u64);
        downed.species.push(14);
        downed.kind.push(DownedLogKind::Trunk);
        downed.east_m.push(place[0]);
        downed.north_m.push(place[1]);
        downed.z_m.push(350.0 + place[2]);
        downed.length_m.push(9.0);
        downed.diameter_base_m.push(0.5);
        downed.diameter_tip_m.push(0.2);
        downed.azimuth_rad.push(0.4);
        downed.years_down.push(5.5);
        downed.decay_class.push(2);
        downed.density_fraction.push(0.8);
        downed.cause.push(Cause::Decay);
        self.put(3, i, place, [9.0, 0.5, 0.5], 1.1);
    }
}

fn empty(archetype: usize, table: FeatureTable) -> InstanceGroup {
    InstanceGroup {
        archetype,
        table,
        row: vec![],
        position_m: vec![],
        rotation: vec![],
        scale: vec![],
        tint_srgb: vec![],
    }
}
