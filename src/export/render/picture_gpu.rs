//! What each sample of a picture shows, and depth maps, by a graphics card: twin of [`super::picture`], [`super::shadow`] and what they
//! draw by, which define the result; same names, same steps, the same surfaces but for roundings of edges.
//!
//! The card decides what is nearest, in bands of the picture; the CPU reads back four words a sample and lights them.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::camera::Camera;
use super::camera_gpu::{View, ground_range};
use super::coverage::Window;
use super::draw_list::{Detail, Item};
use super::draw_list_gpu::{
    Batches, ItemCall, MOST_LEAVES_AT_ONCE, MOST_VERTICES, Parameters, Purpose, Step,
};
use super::ground::Ground;
use super::ground_mesh::{self, PATCH_CELLS, Patch};
use super::models_gpu::Models;
use super::noise;
use super::picture::{self, Sight};
use super::shadow;
use super::strew::{self, Tuft};
use super::surface_buffer::{Sample, Surface};
use super::vector::{UP, Vec3, vec3};
use super::world::World;
use crate::gpu::{
    Buffer, BufferUse, Device, DrawCall, GpuError, Pipeline, PipelineParts, Target, TargetUse,
};
use crate::tree::mesh::Material;

macro_rules! shader {
    ($($name:literal),*) => {
        concat!($(include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/render/", $name))),*)
    };
}

/// The text that draws models and leaves.
pub const FOLIAGE_WGSL: &str =
    shader!("noise.wgsl", "camera.wgsl", "surface_buffer.wgsl", "items.wgsl", "foliage.wgsl");
/// The text that draws splats.
pub const SPLAT_WGSL: &str =
    shader!("noise.wgsl", "camera.wgsl", "surface_buffer.wgsl", "splat.wgsl");
/// The text that draws the terrain.
pub const GROUND_WGSL: &str =
    shader!("noise.wgsl", "camera.wgsl", "surface_buffer.wgsl", "ground.wgsl", "ground_mesh.wgsl");
/// The text that draws what is strewn on it.
pub const STREW_WGSL: &str =
    shader!("noise.wgsl", "camera.wgsl", "surface_buffer.wgsl", "ground.wgsl", "strew.wgsl");
/// The text that draws models into depth maps.
pub const SHADOW_WGSL: &str = shader!("noise.wgsl", "camera.wgsl", "items.wgsl", "shadow.wgsl");

/// A splat, as the WGSL text has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[allow(missing_docs, reason = "the text tells what the fields are")]
pub struct SplatRecord {
    pub middle_px: [f32; 2],
    pub size_px: [f32; 2],
    pub nearness: f32,
    pub area_px: f32,
    pub place: u32,
    pub word: u32,
}

/// A patch of terrain, as the WGSL text has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[allow(missing_docs, reason = "the text tells what the fields are")]
pub struct PatchRecord {
    pub row: u32,
    pub col: u32,
    pub step: u32,
    pub pad: u32,
}

/// A square of ground that is strewn, as the WGSL text has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[allow(missing_docs, reason = "the text tells what the fields are")]
pub struct TuftRecord {
    pub col: i32,
    pub row: i32,
    pub px_per_m: f32,
    pub counts: u32,
}

/// Most samples drawn at once. chosen: 16 bytes each twice and 4 of depth are 650 MB, which small cards have; pictures of 2560 × 1440 pixels at
/// two samples are one band, and so are the largest depth maps.
const MOST_SAMPLES: usize = 18_000_000;
/// Items handed over at once. chosen: 25 MB.
const MOST_ITEMS: usize = 1 << 18;
/// Splats handed over at once. chosen: 32 MB.
const MOST_SPLATS: usize = 1 << 20;
/// Rows of samples that are lit at once, by one thread.
const ROWS_LIT: usize = 4;
/// Calls handed over at once. chosen: their parameters are 1 MB.
const MOST_CALLS: usize = 4096;
/// Squares of ground are drawn together with those that bear as many blades or leaves but for so many.
const TUFT_GRAIN: u32 = 40;
/// What stands for no ground; the WGSL text tells it from heights.
const NO_GROUND_M: f32 = -3e30;

/// The texts of all pipelines: tests give wrong ones and see that they notice.
#[derive(Clone, Debug)]
#[allow(missing_docs, reason = "named as the constants that they are by default")]
pub struct Texts {
    pub foliage: String,
    pub splat: String,
    pub ground: String,
    pub strew: String,
    pub shadow: String,
}

impl Default for Texts {
    fn default() -> Self {
        let [foliage, splat, ground, strew, shadow] =
            [FOLIAGE_WGSL, SPLAT_WGSL, GROUND_WGSL, STREW_WGSL, SHADOW_WGSL].map(str::to_owned);
        Self { foliage, splat, ground, strew, shadow }
    }
}

/// A graphics card that draws. Its buffers are kept from picture to picture.
#[derive(Debug)]
pub struct GpuPainter {
    device: Device,
    /// By [`Step`].
    steps: [Pipeline; 5],
    splat: Pipeline,
    ground: [Pipeline; 2],
    strew: [Pipeline; 2],
    cast: [Pipeline; 2],
    cast_splat: Pipeline,
    cast_ground: [Pipeline; 2],
    view: Buffer,
    items: Buffer,
    corners: Buffer,
    triangles: Buffer,
    splats: Buffer,
    heights: Buffer,
    patches: Buffer,
    field: Buffer,
    tufts: Buffer,
    /// Vertices of leaves' triangles, as kites and with a rounded outline.
    leaf_indices: [Buffer; 2],
    parameters: Buffer,
    answer: Buffer,
    most_samples: usize,
}

/// A call with its parameters.
struct Call {
    words: Parameters,
    vertices: u32,
    instances: u32,
}

impl Call {
    fn of(call: &ItemCall) -> Self {
        Self::new(&call.words, call.vertices, call.instances)
    }

    fn new(words: &[u32], vertices: u32, instances: u32) -> Self {
        let mut parameters: Parameters = [0; size_of::<Parameters>() / size_of::<u32>()];
        parameters[..words.len()].copy_from_slice(words);
        Self { words: parameters, vertices, instances }
    }
}

impl GpuPainter {
    /// A painter on `device`.
    ///
    /// # Errors
    /// If the card's driver cannot compile the pipelines.
    pub fn new(device: &Device) -> Result<Self, GpuError> {
        Self::with_texts(device, &Texts::default())
    }

    /// As [`Self::new`] with other texts.
    ///
    /// # Errors
    /// If the card's driver cannot compile the pipelines.
    pub fn with_texts(device: &Device, texts: &Texts) -> Result<Self, GpuError> {
        let triangles = |vertex, fragment, storage| PipelineParts {
            vertex,
            fragment,
            is_points: false,
            storage,
        };
        let points =
            |vertex, fragment| PipelineParts { vertex, fragment, is_points: true, storage: 1 };
        let show = Some("show");
        let (words, depth) = (TargetUse::Words, TargetUse::Depth);
        let steps = Step::ALL.map(|step| match step {
            Step::Part => triangles("part", show, 3),
            Step::PartCut => triangles("part", Some("show_cut"), 3),
            Step::Inside => triangles("inside", show, 3),
            Step::Leaf | Step::RoundLeaf => triangles("leaf", show, 3),
        });
        let terrain = |fragment| ["ground", "skirt"].map(|vertex| triangles(vertex, fragment, 2));
        let [splat] = device.pipelines("splats", &texts.splat, words, [points("splat", show)])?;
        let [cast_splat] = device.pipelines(
            "splats' shadows",
            &texts.splat,
            depth,
            [points("cast_splat", None)],
        )?;
        let strew = ["grass", "litter"].map(|vertex| triangles(vertex, show, 3));
        let cast =
            [triangles("cast_part", None, 3), triangles("cast_foliage", Some("leave_gaps"), 3)];
        Ok(Self {
            steps: device.pipelines("models", &texts.foliage, words, steps)?,
            splat,
            ground: device.pipelines("terrain", &texts.ground, words, terrain(show))?,
            strew: device.pipelines("grass and litter", &texts.strew, words, strew)?,
            cast: device.pipelines("models' shadows", &texts.shadow, depth, cast)?,
            cast_splat,
            cast_ground: device.pipelines(
                "terrain's shadow",
                &texts.ground,
                depth,
                terrain(None),
            )?,
            view: device.buffer("camera", BufferUse::Uniform),
            items: device.buffer("instances", BufferUse::Storage),
            corners: device.buffer("vertices of models", BufferUse::Storage),
            triangles: device.buffer("triangles of models", BufferUse::Storage),
            splats: device.buffer("small instances", BufferUse::Storage),
            heights: device.buffer("heights of the terrain", BufferUse::Storage),
            patches: device.buffer("patches of terrain", BufferUse::Storage),
            field: device.buffer("map of the forest floor", BufferUse::Storage),
            tufts: device.buffer("squares of ground", BufferUse::Storage),
            leaf_indices: [leaf_indices(device, 4, &KITE)?, leaf_indices(device, 6, &ROUND)?],
            parameters: device.buffer("calls", BufferUse::Calls),
            answer: device.buffer("samples", BufferUse::Answer),
            most_samples: MOST_SAMPLES,
            device: device.clone(),
        })
    }

    /// The same with smaller bands, which change no result but for roundings.
    pub fn with_most_samples(mut self, samples: usize) -> Self {
        self.most_samples = samples;
        self
    }

    /// The card it is.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// What `light` makes of the samples of each window of a picture; windows are rows of it, and all of them fill it.
    ///
    /// # Errors
    /// If the card fails.
    pub fn surfaces<R: Send>(
        &mut self,
        sight: &Sight<'_>,
        light: impl Fn(Window, &[Sample]) -> R + Sync,
    ) -> Result<Vec<(Window, R)>, GpuError> {
        let Sight { world, camera, items, options } = *sight;
        let listed = Listed { world, camera, items };
        let purpose = Purpose::Picture { has_walls: options.has_walls };
        let batches = Batches::of(world, camera, items, purpose);
        let models = Models::of(world, items);
        let splats = splats(listed);
        let patches = patches(listed, None);
        let tufts = if options.is_strewn { tufts(listed) } else { Vec::new() };
        self.corners.write(&models.corners)?;
        self.triangles.write(&models.triangles)?;
        self.write_ground(&world.ground, &patches)?;

        let mut view = View::of(camera, &world.ground, nearness_range(listed));
        view.has_walls = u32::from(options.has_walls);
        // as many samples as the camera has pixels
        let size = camera.size_px.map(|side| side as u32);
        let mut all = Vec::new();
        for band in self.bands(size, 16) {
            self.view.write(&[view.within(band)])?;
            let target = self.begin(band, TargetUse::Words)?;
            self.draw_items(&target, listed, &models, &batches)?;
            for (dots, splats) in (1..).zip(&splats) {
                self.draw_splats(&target, splats, dots)?;
            }
            self.draw_tufts(&target, &world.ground, &tufts)?;
            self.draw_ground(&target, &patches)?;
            let lit: Vec<(Window, R)> = self.read(&target, |words: &[[u32; 4]], row_samples| {
                let groups = words.par_chunks(row_samples * ROWS_LIT).enumerate();
                let lit = groups.map(|(group, rows)| {
                    let top = band.top + (group * ROWS_LIT) as i32; // within the band
                    let count = (rows.len() / row_samples) as i32; // a few
                    let window = Window { top, bottom: top + count, ..band };
                    let rows = rows.chunks_exact(row_samples);
                    let samples: Vec<Sample> = rows
                        .flat_map(|row| row[..band.width()].iter().map(|words| sample(*words)))
                        .collect();
                    (window, light(window, &samples))
                });
                lit.collect()
            })?;
            all.extend(lit);
        }
        Ok(all)
    }

    /// Nearness of what the sun sees in each pixel of a depth map, −∞ where there is nothing.
    ///
    /// # Errors
    /// If the card fails.
    pub fn depth_map(
        &mut self,
        world: &World<'_>,
        camera: &Camera,
        items: &[Item],
        side_px: u32,
        texel_m: f32,
    ) -> Result<Vec<f32>, GpuError> {
        let listed = Listed { world, camera, items };
        let batches = Batches::of(world, camera, items, Purpose::DepthMap);
        let models = Models::of(world, items);
        let splats: Vec<SplatRecord> =
            items.par_iter().filter_map(|item| cast_splat(item, side_px)).collect();
        let patches = patches(listed, Some(shadow::ground_step(&world.ground, texel_m)));
        self.corners.write(&models.corners)?;
        self.triangles.write(&models.triangles)?;
        self.write_ground(&world.ground, &patches)?;

        let mut view = View::of(camera, &world.ground, nearness_range(listed));
        view.needs_all_corners = 1;
        view.gap_m = shadow::gap_m(texel_m);
        view.gap_threshold = shadow::GAP_THRESHOLD;
        let side = side_px as usize; // some thousand
        let mut nearness = vec![f32::NEG_INFINITY; side * side];
        for band in self.bands([side_px; 2], 4) {
            self.view.write(&[view.within(band)])?;
            let target = self.begin(band, TargetUse::Depth)?;
            self.draw_items(&target, listed, &models, &batches)?;
            self.draw_splats(&target, &splats, 1)?;
            self.draw_ground(&target, &patches)?;
            // bands lie within the map
            let (top, left) = (band.top as usize, band.left as usize);
            let into = &mut nearness[top * side..band.bottom as usize * side];
            self.read(&target, |depths: &[f32], row_values| {
                let rows = into.par_chunks_mut(side).zip(depths.par_chunks(row_values));
                rows.for_each(|(into, depths)| {
                    let into = &mut into[left..left + band.width()];
                    into.iter_mut().zip(depths).for_each(|(to, from)| *to = view.nearness(*from));
                });
            })?;
        }
        Ok(nearness)
    }

    /// Bands that a picture is drawn in: as large as the card takes.
    fn bands(&self, [across, down]: [u32; 2], sample_bytes: u64) -> Vec<Window> {
        let most_side = self.device.largest_side_px();
        let width = across.min(most_side);
        // a row more than its samples: rows are padded; a limit beyond usize is no limit
        let held = usize::try_from(self.device.largest_answer_bytes() / sample_bytes);
        let most = self.most_samples.min(held.unwrap_or(usize::MAX));
        let rows = (most / (width as usize + 64)).clamp(1, most_side as usize);
        let mut bands = Vec::new();
        for top in (0..down as usize).step_by(rows) {
            for left in (0..across).step_by(width as usize) {
                // pictures are far smaller than 2³¹ pixels wide
                bands.push(Window {
                    left: left as i32,
                    top: top as i32,
                    right: across.min(left + width) as i32,
                    bottom: (down as usize).min(top + rows) as i32,
                });
            }
        }
        bands
    }

    fn begin(&mut self, band: Window, usage: TargetUse) -> Result<Target, GpuError> {
        let size = [band.width() as u32, band.height() as u32]; // below the card's limit
        let target = self.device.target(size, usage)?;
        self.answer.reserve(target.copy_bytes())?;
        self.device.submit("picture", |commands| commands.begin(&target))?;
        Ok(target)
    }

    fn draw_items(
        &mut self,
        target: &Target,
        listed: Listed<'_>,
        models: &Models,
        batches: &Batches,
    ) -> Result<(), GpuError> {
        let is_map = target.usage() == TargetUse::Depth;
        for first in (0..batches.len()).step_by(MOST_ITEMS) {
            let range = first..(first + MOST_ITEMS).min(batches.len());
            let records = batches.records(listed.world, listed.camera, listed.items, range.clone());
            self.items.write(&records)?;
            let memory = [&self.view, &self.items, &self.corners, &self.triangles];
            let calls = batches.calls(models, &records, range);
            for run in calls.chunk_by(|a, b| a.step == b.step) {
                let step = run[0].step;
                let pipeline = match step {
                    _ if !is_map => &self.steps[step as usize],
                    Step::Part | Step::PartCut => &self.cast[0],
                    Step::Inside | Step::Leaf | Step::RoundLeaf => &self.cast[1],
                };
                let run: Vec<Call> = run.iter().map(Call::of).collect();
                let indices = match step {
                    Step::Leaf => Some(&self.leaf_indices[0]),
                    Step::RoundLeaf => Some(&self.leaf_indices[1]),
                    _ => None,
                };
                let drawn = Drawn { target, pipeline, memory: &memory, indices };
                submit(&self.device, &mut self.parameters, &drawn, &run)?;
            }
        }
        Ok(())
    }

    fn draw_splats(
        &mut self,
        target: &Target,
        splats: &[SplatRecord],
        most_dots: u32,
    ) -> Result<(), GpuError> {
        let pipeline = match target.usage() {
            TargetUse::Words => &self.splat,
            TargetUse::Depth => &self.cast_splat,
        };
        for group in splats.chunks(MOST_SPLATS) {
            self.splats.write(group)?;
            let call = Call::new(&[0], most_dots, group.len() as u32); // some hundred thousand
            let memory = [&self.view, &self.splats];
            submit(
                &self.device,
                &mut self.parameters,
                &Drawn { target, pipeline, memory: &memory, indices: None },
                &[call],
            )?;
        }
        Ok(())
    }

    /// Hands heights and patches over; the latter in an order that [`Self::draw_ground`] goes by.
    fn write_ground(&mut self, ground: &Ground, patches: &[PatchRecord]) -> Result<(), GpuError> {
        let height = |z: &f32| if z.is_finite() { *z } else { NO_GROUND_M };
        let heights: Vec<f32> = ground.heights_m().par_iter().map(height).collect();
        self.heights.write(&heights)?;
        self.patches.write(patches)
    }

    fn draw_ground(&mut self, target: &Target, patches: &[PatchRecord]) -> Result<(), GpuError> {
        let is_map = target.usage() == TargetUse::Depth;
        let [ground, skirt] = if is_map { &self.cast_ground } else { &self.ground };
        let (mut squares, mut sides) = (Vec::new(), Vec::new());
        let mut first = 0;
        for run in patches.chunk_by(|a, b| a.step == b.step) {
            let across = (PATCH_CELLS as u32).div_ceil(run[0].step); // 32 or fewer
            let count = run.len() as u32; // patches are some thousand
            let words = [first, across];
            squares.push(Call::new(&words, 6 * across * across, count));
            sides.push(Call::new(&words, 6 * 4 * across, count));
            first += count;
        }
        let memory = [&self.view, &self.heights, &self.patches];
        submit(
            &self.device,
            &mut self.parameters,
            &Drawn { target, pipeline: ground, memory: &memory, indices: None },
            &squares,
        )?;
        if is_map {
            return Ok(()); // no more than surfaces casts a shadow
        }
        submit(
            &self.device,
            &mut self.parameters,
            &Drawn { target, pipeline: skirt, memory: &memory, indices: None },
            &sides,
        )
    }

    fn draw_tufts(
        &mut self,
        target: &Target,
        ground: &Ground,
        tufts: &[TuftRecord],
    ) -> Result<(), GpuError> {
        if tufts.is_empty() {
            return Ok(());
        }
        self.tufts.write(tufts)?;
        let fields = [&ground.grass_m, &ground.litterfall];
        for (which, field) in fields.into_iter().enumerate() {
            let Some(field) = field else { continue };
            let cells = field.cells();
            self.field.write(cells.values)?;
            let count_of = |tuft: &TuftRecord| (tuft.counts >> (16 * which)) & 0xffff;
            let vertices = [9, 6][which];
            let mut calls = Vec::new();
            let mut first = 0;
            // from near to far squares bear less and less
            for run in tufts.chunk_by(|a, b| count_of(a) / TUFT_GRAIN == count_of(b) / TUFT_GRAIN) {
                let most = run.iter().map(count_of).max().unwrap_or(0);
                // squares are some thousand, and maps have fewer than 2³² cells
                let words = [
                    first,
                    0,
                    cells.cols as u32,
                    cells.rows as u32,
                    cells.cell_m.to_bits(),
                    cells.west_m.to_bits(),
                    cells.north_m.to_bits(),
                ];
                let count = run.len() as u32;
                calls.push(Call::new(&words, vertices * most, count));
                first += count;
            }
            let memory = [&self.view, &self.heights, &self.field, &self.tufts];
            let pipeline = &self.strew[which];
            submit(
                &self.device,
                &mut self.parameters,
                &Drawn { target, pipeline, memory: &memory, indices: None },
                &calls,
            )?;
        }
        Ok(())
    }

    /// What `take` makes of what was drawn, given the values of a row in memory.
    fn read<T: bytemuck::AnyBitPattern, R>(
        &mut self,
        target: &Target,
        take: impl FnOnce(&[T], usize) -> R,
    ) -> Result<R, GpuError> {
        self.device.submit("picture", |commands| commands.copy_picture(target, &self.answer))?;
        // pictures fit into memory
        let values = |bytes: u64| bytes as usize / size_of::<T>();
        let row = values(target.row_bytes());
        self.device.read(&self.answer, values(target.copy_bytes()), |all| take(all, row))
    }
}

/// Items of a world before a camera.
#[derive(Clone, Copy)]
struct Listed<'a> {
    world: &'a World<'a>,
    camera: &'a Camera,
    items: &'a [Item],
}

/// Where to, how and from what calls are drawn.
struct Drawn<'a> {
    target: &'a Target,
    pipeline: &'a Pipeline,
    memory: &'a [&'a Buffer],
    indices: Option<&'a Buffer>,
}

/// Corners of a leaf's triangles among its vertices: a kite's, and those of a rounded outline.
const KITE: [u32; 6] = [0, 1, 2, 0, 2, 3];
const ROUND: [u32; 12] = [0, 1, 5, 1, 2, 5, 2, 4, 5, 2, 3, 4];

/// The triangles of as many leaves as a call may have.
fn leaf_indices(device: &Device, corners: u32, triangles: &[u32]) -> Result<Buffer, GpuError> {
    let leaves = 0..MOST_LEAVES_AT_ONCE;
    let of_leaf = |leaf: u32| triangles.iter().map(move |corner| leaf * corners + corner);
    let mut buffer = device.buffer("corners of leaves", BufferUse::Indices);
    buffer.write(&leaves.flat_map(of_leaf).collect::<Vec<u32>>())?;
    Ok(buffer)
}

/// Hands calls of one pipeline over, no more at once than a card may work on without a break.
fn submit(
    device: &Device,
    parameters: &mut Buffer,
    drawn: &Drawn<'_>,
    calls: &[Call],
) -> Result<(), GpuError> {
    let mut rest = calls;
    while !rest.is_empty() {
        let mut vertices = 0_u64;
        let fits = |call: &&Call| {
            vertices += u64::from(call.vertices) * u64::from(call.instances);
            vertices <= u64::from(MOST_VERTICES)
        };
        let count = rest.iter().take(MOST_CALLS).take_while(fits).count().max(1);
        let (now, later) = rest.split_at(count);
        let words: Vec<Parameters> = now.iter().map(|call| call.words).collect();
        parameters.write(&words)?;
        let draws: Vec<DrawCall> = (0..)
            .zip(now)
            .map(|(parameters, call)| {
                let Call { vertices, instances, .. } = *call;
                DrawCall { parameters, vertices, instances }
            })
            .collect();
        let parameters = &*parameters;
        device.submit("picture", |commands| {
            let Drawn { target, pipeline, memory, indices } = *drawn;
            commands.draw(target, pipeline, memory, indices, parameters, &draws);
        })?;
        rest = later;
    }
    Ok(())
}

/// The farthest and the nearest that anything is from a camera with parallel rays.
fn nearness_range(listed: Listed<'_>) -> [f32; 2] {
    let [far, near] = ground_range(listed.camera, &listed.world.ground);
    // leaves stand off their crowns
    let reach = |item: &Item| 1.5 * item.radius_m + 1.0;
    let items = listed.items.par_iter();
    let of_items = items.map(|item| [-item.depth_m - reach(item), -item.depth_m + reach(item)]);
    of_items.reduce(|| [far, near], |a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

/// Splats of a picture, by the number of dots that they may have.
fn splats(listed: Listed<'_>) -> Vec<Vec<SplatRecord>> {
    let Listed { world, camera, items } = listed;
    let splat = |(place, item): (usize, &Item)| {
        let is_splat = item.detail == Detail::Splat && world.has_leaves(item);
        if !is_splat {
            return None;
        }
        let splat = picture::Splat::of(camera, item);
        // at most a dozen
        let dots = (splat.area_px as u32 + 1).min(picture::MOST_DOTS);
        let [least, ..] = noise::four(noise::hash2(splat.word, 0));
        let record = SplatRecord {
            middle_px: splat.middle_px,
            size_px: splat.size_px,
            nearness: splat.nearness,
            area_px: splat.area_px,
            place: place as u32, // fewer than 2³² items
            word: splat.word,
        };
        (splat.area_px >= least).then_some((dots, record))
    };
    let seen: Vec<(u32, SplatRecord)> = items.par_iter().enumerate().filter_map(splat).collect();
    let mut by_dots = vec![Vec::new(); picture::MOST_DOTS as usize];
    for (dots, record) in seen {
        by_dots[dots as usize - 1].push(record);
    }
    by_dots
}

/// A splat of a depth map, `None` where it casts no shadow.
fn cast_splat(item: &Item, side_px: u32) -> Option<SplatRecord> {
    if item.detail != Detail::Splat {
        return None;
    }
    let [col, row] = shadow::splat_texel(item)?;
    // maps have fewer than 2²⁴ texels a side
    let side = side_px as i32;
    let is_within = col >= 0 && col < side && row >= 0 && row < side;
    is_within.then(|| SplatRecord {
        middle_px: [col as f32, row as f32],
        nearness: -item.depth_m,
        ..SplatRecord::default()
    })
}

/// Patches in the order of their steps; all of one step where one is given.
fn patches(listed: Listed<'_>, step: Option<usize>) -> Vec<PatchRecord> {
    let mut patches = ground_mesh::visible(&listed.world.ground, listed.camera);
    if let Some(step) = step {
        patches.iter_mut().for_each(|patch| patch.step = step);
    }
    patches.sort_by_key(|patch| patch.step); // stable: the nearest first
    let record = |patch: &Patch| PatchRecord {
        // grids have fewer than 2³² rows
        row: patch.row as u32,
        col: patch.col as u32,
        step: patch.step as u32,
        pad: 0,
    };
    patches.iter().map(record).collect()
}

fn tufts(listed: Listed<'_>) -> Vec<TuftRecord> {
    let record = |tuft: &Tuft| {
        let px_per_m = strew::px_per_m(listed.camera, tuft);
        let [blades, leaves] = strew::counts(px_per_m); // some hundreds
        TuftRecord { col: tuft.col, row: tuft.row, px_per_m, counts: blades | leaves << 16 }
    };
    strew::visible(listed.world, listed.camera).iter().map(record).collect()
}

/// A sample from its four words.
#[inline]
fn sample([item, ink, normal, nearness]: [u32; 4]) -> Sample {
    let surface = match ink & 0xff {
        1 => Surface::Ground,
        2 => Surface::Wall,
        3 => Surface::Grass,
        4 => Surface::Litter,
        code @ 5..=8 => Surface::Part(Material::ALL[code as usize - 5]),
        _ => return Sample::EMPTY,
    };
    Sample {
        nearness: f32::from_bits(nearness),
        normal: unpacked_normal(normal),
        item,
        surface,
        variation: (ink >> 8) as u8, // a byte each
        openness: (ink >> 16) as u8,
    }
}

/// The direction that two halves of a word stand for, see `packed_normal` in the WGSL text.
#[inline]
fn unpacked_normal(word: u32) -> Vec3 {
    let half = |bits: u32| f32::from(bits as u16 as i16) / 32767.0; // 16 bits with a sign
    let (x, y) = (half(word), half(word >> 16));
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    let unfolded = |v: f32| if v >= 0.0 { v - fold } else { v + fold };
    vec3(unfolded(x), unfolded(y), z).normalize_or(UP)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_keep_what_is_packed_in_words() {
        let kept = sample([7, 6 | 200 << 8 | 90 << 16, 0, 0.25_f32.to_bits()]);
        assert_eq!((kept.item, kept.variation, kept.openness), (7, 200, 90));
        assert_eq!(kept.surface, Surface::Part(Material::Foliage));
        assert_eq!((kept.nearness, kept.normal), (0.25, UP));
        assert_eq!(sample([0; 4]).surface, Surface::Sky);
        // −z is a corner of the square, east the middle of its right side
        assert!((unpacked_normal(0x7fff_7fff) + UP).length() < 1e-4);
        assert!((unpacked_normal(0x0000_7fff) - Vec3::X).length() < 1e-4);
        assert!((unpacked_normal(0x8001_0000) + Vec3::Y).length() < 1e-4);
        for material in Material::ALL {
            let code = super::super::models_gpu::surface_code(material);
            assert_eq!(sample([0, code, 0, 0]).surface, Surface::Part(material));
        }
    }
}
