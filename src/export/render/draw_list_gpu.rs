//! What the graphics card draws of instances: items sorted into batches of one model and about as many leaves, and the calls that draw them.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::camera::Camera;
use super::draw_list::{Detail, Item};
use super::foliage::{Crown, leaf_area_m2};
use super::models_gpu::{Models, model_of};
use super::noise;
use super::vector::{Vec3, vec3};
use super::world::World;
use crate::export::instances::FeatureTable;
use crate::gpu::CALL_BYTES;
use crate::math;

/// An item, as the WGSL text has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[allow(missing_docs, reason = "the text tells what the fields are")]
pub struct ItemRecord {
    pub position: [f32; 3],
    pub place: u32,
    pub axis_x: [f32; 3],
    pub seed: u32,
    pub axis_y: [f32; 3],
    pub leaf_m: f32,
    pub axis_z: [f32; 3],
    pub fringe_m: f32,
    pub lump_m: f32,
    pub lump_reach_m: f32,
    pub inset_m: f32,
    pub cover: f32,
    pub width: f32,
    pub droop: f32,
    pub lumpiness: f32,
    pub is_leafy: u32,
}

/// Parameters of a call; each pipeline's text tells what its words are.
pub type Parameters = [u32; CALL_BYTES / size_of::<u32>()];

/// What draws an item.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Step {
    /// Bark, wood and soil.
    Part,
    /// The same of what is cut where the ground ends.
    PartCut,
    /// The inside of crowns.
    Inside,
    /// Leaves, as kites.
    Leaf,
    /// Leaves with a rounded outline.
    RoundLeaf,
}

impl Step {
    /// All, in the order they are drawn.
    pub const ALL: [Self; 5] =
        [Self::Part, Self::PartCut, Self::Inside, Self::Leaf, Self::RoundLeaf];
}

/// A call of the pipeline of a step.
#[derive(Clone, Debug)]
pub struct ItemCall {
    /// Which pipeline.
    pub step: Step,
    /// Its parameters.
    pub words: [u32; 4],
    /// Vertices of an instance, or indices of a leaf's vertices.
    pub vertices: u32,
    /// Instances.
    pub instances: u32,
}

/// Items of one model and about as many leaves.
#[derive(Clone, Copy, Debug)]
pub struct Batch {
    model: usize,
    is_cut: bool,
    leaves: Leaves,
    /// First in the order of [`Batches::places`].
    first: usize,
    count: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Leaves {
    /// No foliage.
    None,
    /// Foliage without leaves on it.
    Closed,
    /// Leaves on foliage, or in its place.
    Strewn { is_open: bool, is_round: bool },
}

/// Items sorted into batches.
#[derive(Debug, Default)]
pub struct Batches {
    /// Places of items, batch by batch.
    places: Vec<u32>,
    batches: Vec<Batch>,
}

/// Most leaves of a batch's items over the fewest. chosen: as of [`super::models_gpu`]'s runs.
const BATCH_RATIO: f32 = 1.5;
/// Most vertices of a call. chosen: a card works some hundredths of a second at them; operating systems reset one that is at a call for
/// seconds.
pub const MOST_VERTICES: u32 = 1 << 24;
/// Most leaves of an instance in a call. chosen: the indices of their vertices are 3 MB.
pub const MOST_LEAVES_AT_ONCE: u32 = 1 << 16;
/// Room for triangles that grow as crowns are set in, as a share.
const AREA_SLACK: f32 = 1.1;
/// Room for crowns of a batch that shrink less than the three that are looked at, as they are set in. chosen: they are as large as each
/// other but for a half.
const INSET_SLACK: f32 = 1.25;

/// Whether a picture bears leaves: depth maps have models alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A picture; the terrain's cut sides end what lies across them.
    Picture {
        /// Whether there are cut sides.
        has_walls: bool,
    },
    /// A depth map.
    DepthMap,
}

impl Batches {
    /// Batches of items; splats are in none.
    pub fn of(world: &World<'_>, camera: &Camera, items: &[Item], purpose: Purpose) -> Self {
        let mut keyed: Vec<(u64, u32)> = items
            .par_iter()
            .enumerate()
            .filter_map(|(place, item)| {
                let key = key(world, camera, item, purpose)?;
                Some((key, place as u32)) // fewer than 2³² items
            })
            .collect();
        keyed.par_sort_unstable();
        let mut batches = Vec::new();
        let mut first = 0;
        for run in keyed.chunk_by(|a, b| a.0 == b.0) {
            let key = run[0].0;
            let kind = (key >> KIND_SHIFT) & 7;
            batches.push(Batch {
                model: (key >> MODEL_SHIFT) as usize, // as it was made of one
                is_cut: (key >> CUT_SHIFT) & 1 == 1,
                leaves: match kind {
                    0 => Leaves::None,
                    1 => Leaves::Closed,
                    _ => Leaves::Strewn { is_open: kind & 2 != 0, is_round: kind & 1 != 0 },
                },
                first,
                count: run.len(),
            });
            first += run.len();
        }
        Self { places: keyed.into_iter().map(|(_, place)| place).collect(), batches }
    }

    /// Number of items.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Records of some of the items, in the order of batches.
    pub fn records(
        &self,
        world: &World<'_>,
        camera: &Camera,
        items: &[Item],
        range: std::ops::Range<usize>,
    ) -> Vec<ItemRecord> {
        let record = |place: &u32| record(world, camera, &items[*place as usize], *place);
        self.places[range].par_iter().map(record).collect()
    }

    /// The calls that draw some of the items, whose records are in `records`.
    pub fn calls(
        &self,
        models: &Models,
        records: &[ItemRecord],
        range: std::ops::Range<usize>,
    ) -> Vec<ItemCall> {
        let of_batch = |batch: &Batch| {
            let first = batch.first.max(range.start);
            let end = (batch.first + batch.count).min(range.end);
            let mut calls = Vec::new();
            if first < end {
                let within = first - range.start..end - range.start;
                batch.calls(models, &records[within.clone()], within.start, &mut calls);
            }
            calls
        };
        let mut calls: Vec<ItemCall> = self.batches.par_iter().flat_map_iter(of_batch).collect();
        calls.sort_by_key(|call| call.step); // stable
        calls
    }
}

impl Batch {
    fn calls(
        &self,
        models: &Models,
        records: &[ItemRecord],
        first: usize,
        calls: &mut Vec<ItemCall>,
    ) {
        let model = &models.models[self.model];
        let mut add = |step: Step, words: [u32; 3], vertices: u32| {
            if vertices == 0 {
                return;
            }
            let [first_triangle, leaves, corners] = words;
            let most = (MOST_VERTICES / vertices).max(1);
            let mut place = first as u32; // some hundred thousand at once
            let end = place + records.len() as u32; // likewise
            while place < end {
                let instances = most.min(end - place);
                let words = [place, first_triangle, leaves, corners];
                calls.push(ItemCall { step, words, vertices, instances });
                place += instances;
            }
        };
        let solid = if self.is_cut { Step::PartCut } else { Step::Part };
        let ([solids, solid_count], [insides, inside_count]) = (model.solid, model.foliage);
        add(solid, [solids, 0, 0], 3 * solid_count);
        match self.leaves {
            Leaves::None => {}
            Leaves::Closed => add(Step::Inside, [insides, 0, 0], 3 * inside_count),
            Leaves::Strewn { is_open, is_round } => {
                if !is_open {
                    add(Step::Inside, [insides, 0, 0], 3 * inside_count);
                }
                let (step, corners, indices) =
                    if is_round { (Step::RoundLeaf, 6, 12) } else { (Step::Leaf, 4, 6) };
                let most =
                    records.iter().fold(Vec3::default(), |most, r| most.max(leaves_per_area(r)));
                let last = records.len() - 1;
                let samples = [0, last / 2, last].map(|place| &records[place]);
                for run in &model.runs {
                    let most_of = |(triangle, area): (u32, &Vec3)| {
                        let shares = samples.map(|record| inset_share(models, triangle, record));
                        let share = shares.into_iter().fold(0.0, f32::max) * INSET_SLACK;
                        (*area * most).length() * share.min(AREA_SLACK)
                    };
                    let numbered = (run.first..).zip(&run.areas);
                    let expected = numbered.map(most_of).fold(0.0, f32::max);
                    let leaves = expected.min(super::foliage::MOST_LEAVES) as u32 + 1; // not negative
                    // a run has some hundred triangles
                    let (mut triangle, end) = (run.first, run.first + run.areas.len() as u32);
                    while triangle < end {
                        let count = (MOST_LEAVES_AT_ONCE / leaves).clamp(1, end - triangle);
                        add(step, [triangle, leaves, corners], count * leaves * indices);
                        triangle += count;
                    }
                }
            }
        }
    }
}

const MODEL_SHIFT: u32 = 32;
const CUT_SHIFT: u32 = 31;
const KIND_SHIFT: u32 = 8;

/// What items are sorted by: model, whether they are cut, kind and number of leaves; `None` of splats.
fn key(world: &World<'_>, camera: &Camera, item: &Item, purpose: Purpose) -> Option<u64> {
    let model = model_of(world, item)? as u64; // usize is at most 64 bits
    let group = &world.instances.groups[item.group as usize];
    let is_cut =
        purpose == Purpose::Picture { has_walls: true } && group.table == FeatureTable::DownedLogs;
    let foliage = world.foliage(group);
    let (kind, step) = if purpose == Purpose::DepthMap {
        (u64::from(world.group_has_leaves(group)), 0)
    } else if let Some(look) = foliage {
        let crown = Crown::of(camera, item, look);
        if crown.is_leafy {
            let [x, y, z] = item.axes.map(Vec3::length);
            // leaves on a sphere of the crown's size
            let surface = (x * y + y * z + z * x) / crown.leaf_area_m2;
            let step = math::ln(surface.max(1.0)) / math::ln(BATCH_RATIO);
            let kind = 4 | u64::from(crown.is_open) << 1 | u64::from(crown.is_round);
            (kind, step.min(255.0) as u64) // not negative
        } else {
            (u64::from(!look.is_bare), 0)
        }
    } else {
        (0, 0)
    };
    Some(model << MODEL_SHIFT | u64::from(is_cut) << CUT_SHIFT | kind << KIND_SHIFT | step)
}

/// Leaves on a unit of area of the model, over its three planes.
fn leaves_per_area(record: &ItemRecord) -> Vec3 {
    let size = |axis: [f32; 3]| Vec3::from(axis).length();
    let [x, y, z] = [size(record.axis_x), size(record.axis_y), size(record.axis_z)];
    let density = record.cover / leaf_area_m2(record.leaf_m, record.width).max(1e-9);
    vec3(y * z, x * z, x * y) * density
}

/// A triangle's area on a crown that is set in, over that on the crown as it is.
fn inset_share(models: &Models, triangle: u32, record: &ItemRecord) -> f32 {
    let item = Item {
        group: 0,
        index: 0,
        detail: Detail::Splat,
        position: record.position.into(),
        axes: [record.axis_x, record.axis_y, record.axis_z].map(Vec3::from),
        depth_m: 0.0,
        radius_m: 0.0,
        rect_px: [0.0; 4],
    };
    let corners = models.triangles[triangle as usize].corners;
    let corners = corners.map(|corner| models.corners[corner as usize]);
    let area = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a).length();
    let whole = corners.map(|corner| item.place(corner.position));
    let inset = corners
        .map(|corner| item.place(corner.position) - item.normal(corner.normal) * record.inset_m);
    area(inset) / area(whole).max(1e-9)
}

fn record(world: &World<'_>, camera: &Camera, item: &Item, place: u32) -> ItemRecord {
    let group = &world.instances.groups[item.group as usize];
    let look = world.foliage(group).unwrap_or(&world.leaves[world.species(group)]);
    let crown = Crown::of(camera, item, look);
    let [axis_x, axis_y, axis_z] = item.axes.map(|axis| axis.to_array());
    ItemRecord {
        position: item.position.to_array(),
        place,
        axis_x,
        seed: noise::hash2(item.group, item.index),
        axis_y,
        leaf_m: crown.leaf_m,
        axis_z,
        fringe_m: crown.fringe_m,
        lump_m: crown.lump_m,
        lump_reach_m: crown.lump_reach_m,
        inset_m: crown.inset_m,
        cover: crown.cover,
        width: look.width,
        droop: look.droop,
        lumpiness: look.lumpiness,
        is_leafy: u32::from(crown.is_leafy),
    }
}
