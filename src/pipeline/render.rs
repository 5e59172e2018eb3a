//! Pictures of a scene: reads it, looks at it through cameras, writes PNG files.
//!
//! Reading order: [`RenderRequest`], [`run`].

use std::fs;
use std::path::{Path, PathBuf};

use image::RgbImage;
use tempfile::TempDir;

use super::Error;
use super::export_output::{check_apart, check_file, write_error};
use super::scene_content::{read_manifest, read_scene};
use crate::abiotics::solar;
use crate::export::canvas::{Canvas, Rect};
use crate::export::furniture;
use crate::export::instances::Instances;
use crate::export::lettering::Lettering;
use crate::export::preview;
use crate::export::render::camera::{Camera, Projection, direction_angles};
use crate::export::render::figures::{self, Colour};
use crate::export::render::ground::{Field, Ground};
use crate::export::render::lighting::{Lighting, clear_m, is_far};
use crate::export::render::painter::Painter;
use crate::export::render::picture::{self, PictureOptions};
use crate::export::render::shading::Lights;
use crate::export::render::sky::Sky;
use crate::export::render::vector::{Vec3, vec3};
use crate::export::render::view;
use crate::export::render::world::{Season, World};
use crate::export::selection::{Filter, Selection};
use crate::gpu::{Device, GpuChoice, GpuError};
use crate::io::{Limits, raster_file};
use crate::math;
use crate::progress::{Reporter, Warning};
use crate::raster::{Frame, GeoTransform, Grid, MapWindow, Mask};
use crate::scene::{self, Manifest};

/// Sizes a picture may have each way, pixels. chosen: below, nothing is told apart; above, memory runs out.
pub const SIZES_PX: std::ops::RangeInclusive<u32> = 16..=8192;
/// Most samples of a picture. chosen: some 2 GiB of light.
const MOST_SAMPLES: u64 = 80_000_000;
/// Width of a section, m, where the scene is wider. chosen: a hand's breadth of trees, each a finger tall.
const SECTION_WIDTH_M: f64 = 100.0;
/// Depth of a section. chosen: as foresters lay transects, 10–20 m.
const SECTION_DEPTH_M: f64 = 15.0;
/// Day and hour of the sun that is not given: a summer morning, when relief shows (15 June, 9.3 h of solar time).
const SUN_DAY: u32 = 166;
const SUN_HOUR: f64 = 9.3;
/// Least elevation of that sun, rad. chosen: near the poles shadows would be all there is.
const LEAST_SUN_RAD: f64 = 0.35;
/// Moisture of the driest month at which grass is straw, and at which it is green, mm. chosen: Sonoma's open hills in July against its woods.
const STRAW_MM: f32 = 18.0;
const GREEN_MM: f32 = 75.0;
/// What PNG files begin with.
const PNG_HEAD: &[u8] = b"\x89PNG\r\n\x1a\n";

/// From where one looks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum ViewRequest {
    /// Obliquely from the air, the whole tile in sight.
    #[default]
    Overview,
    /// From eye height, at a good spot in the forest.
    ForestFloor,
    /// A section from the side.
    Profile,
    /// From above.
    Map,
    /// From a place of one's own.
    Placed {
        /// East and north in map coordinates, and elevation.
        eye: [f64; 3],
        /// Where to.
        aim: Aim,
        /// Field of view across the picture.
        fov_rad: f32,
    },
}

/// Where a camera looks to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// Along azimuth (clockwise from grid north) and pitch (up positive).
    Angles([f32; 2]),
    /// To a place: east and north in map coordinates, and elevation.
    Place([f64; 3]),
}

/// What pictures are asked for.
#[derive(Clone, Debug)]
pub struct RenderRequest {
    /// Scene folder.
    pub folder: PathBuf,
    /// PNG file; with a turntable the frames' numbers are put before its ending.
    pub output: PathBuf,
    /// From where one looks.
    pub view: ViewRequest,
    /// Width and height in pixels.
    pub size_px: [u32; 2],
    /// Samples a pixel each way, 1–4.
    pub finer: u32,
    /// Part of the scene.
    pub filter: Filter,
    /// Season.
    pub season: Season,
    /// What colours mean.
    pub colour: Colour,
    /// Azimuth from grid north and elevation of the sun, rad; `None` is a summer morning's at the scene's latitude.
    pub sun_rad: Option<[f32; 2]>,
    /// How thick the haze is; 1 is a clear day, 0 none.
    pub haze: f32,
    /// Frames of a turn around the scene's middle; `None` is one picture.
    pub turntable: Option<u16>,
    /// Whether a graphics card draws.
    pub gpu: GpuChoice,
}

impl RenderRequest {
    /// A view of the whole scene on a summer morning, 1280 × 720 pixels.
    pub fn new(folder: PathBuf, output: PathBuf, view: ViewRequest) -> Self {
        Self {
            folder,
            output,
            view,
            size_px: [1280, 720],
            finer: 2,
            filter: Filter::default(),
            season: Season::Summer,
            colour: Colour::Natural,
            sun_rad: None,
            haze: 1.0,
            turntable: None,
            gpu: GpuChoice::default(),
        }
    }
}

/// What was drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// The files, in the order of frames.
    pub files: Vec<PathBuf>,
    /// Number of instances in the scene, or in the part of it.
    pub instances: usize,
    /// From where.
    pub view: ViewRequest,
    /// Where the last picture was taken from: east and north in map coordinates, elevation.
    pub eye: [f64; 3],
    /// Azimuth and pitch it was taken along, rad.
    pub angles_rad: [f32; 2],
    /// The graphics card that drew, `None` if it was the CPU.
    pub gpu: Option<String>,
}

/// Draws pictures of a scene.
///
/// # Errors
/// If the folder holds no scene or nothing to draw, a size or an angle is out of range, a file cannot be written, or a graphics card is
/// required and is missing or fails.
pub fn run(request: &RenderRequest, reporter: &Reporter) -> Result<Rendered, Error> {
    check(request)?;
    let device = Device::open(request.gpu).map_err(gpu_failed)?;
    run_on(device.as_ref(), request, reporter)
}

/// [`run`] on a given graphics card, software too, or on the CPU: for tests and for trying by eye.
///
/// # Errors
/// As [`run`].
pub fn run_on(
    device: Option<&Device>,
    request: &RenderRequest,
    reporter: &Reporter,
) -> Result<Rendered, Error> {
    check(request)?;
    let manifest = read_manifest(&request.folder)?;
    let frames = frame_files(request)?;
    for file in &frames {
        check_apart(file, &request.folder, &manifest)?;
        check_file(file, "PNG", |head| head.starts_with(PNG_HEAD))?;
    }
    let (selection, whole_m, fields) = read(request, &manifest, reporter)?;
    let stage = reporter.stage("render", frames.len() as u64);
    let middle = selection.elevation_m.frame().middle();
    let lowest_m = selection.elevation_m.range().map_or(0.0, |(low, _)| f64::from(low));
    let origin = [middle.east_m, middle.north_m, lowest_m];
    let instances = Instances::of(
        &selection.plants,
        &selection.snags,
        &selection.downed_logs,
        &whole_m,
        &selection.biome,
        origin,
    );
    reporter.check_cancelled()?;
    let mut ground = Ground::new(&selection.elevation_m, origin);
    let [grass, litterfall, moisture] =
        fields.map(|grid| grid.map(|grid| Field::new(&grid, origin, 0.0)));
    (ground.grass_m, ground.litterfall) = (grass, litterfall);
    ground.dryness = moisture;
    let classes = [&selection.snags.decay_class[..], &selection.downed_logs.decay_class[..]];
    let mut world = World::new(&instances, ground, &selection.biome, classes, request.season);
    world.painted = figures::paint(request.colour, &selection, &instances);
    world.is_leafless = request.colour == Colour::Decay;

    let mut gpu = device.map(|device| device.adapter().to_string());
    let mut painter = match Painter::on(device) {
        Err(error) if request.gpu != GpuChoice::Require => by_cpu(&mut gpu, &error, reporter),
        painter => painter.map_err(gpu_failed)?,
    };
    let sun = sun(request, &manifest);
    let sky = Sky::new(sun, request.haze);
    let mut lighting: Option<Lighting> = None;
    let mut pictures = Pictures::begin(&frames)?;
    let mut pictured = None;
    let turn = request.turntable.is_some();
    for (number, file) in frames.iter().enumerate() {
        let turned = std::f32::consts::TAU * number as f32 / frames.len() as f32;
        let wanted = camera(request, &world, sun, origin, if turn { turned } else { 0.0 });
        let (camera, was_lifted) = view::over_ground(wanted, &world.ground);
        if was_lifted && number == 0 {
            let text = "the camera lies under the ground; lifted to half a metre above it";
            reporter.warn(Warning::Other { text: text.to_owned() });
        }
        // far views see the same light from all sides
        let keeps = turn && is_far(&world, &camera);
        let light = match lighting.take() {
            Some(light) if keeps => light,
            _ => by(&mut painter, &mut gpu, request, reporter, |painter| {
                Lighting::new(&world, sky, &camera, painter)
            })?,
        };
        reporter.check_cancelled()?;
        let picture = by(&mut painter, &mut gpu, request, reporter, |painter| {
            take(request, &world, &light, &camera, painter)
        })?;
        let mut canvas = Canvas::from_image(picture);
        figures::draw_key(&mut canvas, request.colour, &selection);
        let picture = canvas.into_image();
        let png = preview::encode_png(&picture).map_err(std::io::Error::other);
        let png = png.map_err(|source| write_error(file, source))?;
        pictures.write(number, &png)?;
        stage.advance(1);
        reporter.check_cancelled()?;
        pictured = Some(camera);
        lighting = Some(light);
    }
    let camera = pictured.ok_or_else(|| Error::Usage {
        what: "--turntable: no frames; give 1 or more".to_owned(),
    })?;
    pictures.commit()?;
    Ok(Rendered {
        files: frames,
        instances: instances.len(),
        view: request.view,
        eye: [
            origin[0] + f64::from(camera.eye.x),
            origin[1] + f64::from(camera.eye.y),
            origin[2] + f64::from(camera.eye.z),
        ],
        angles_rad: direction_angles(Vec3::default(), camera.forward),
        gpu,
    })
}

fn gpu_failed(error: GpuError) -> Error {
    Error::Failed { what: error.to_string() }
}

/// The CPU in a failed graphics card's place, with a warning.
fn by_cpu(gpu: &mut Option<String>, error: &GpuError, reporter: &Reporter) -> Painter {
    let text = format!("the CPU draws, because the graphics card failed: {error}");
    reporter.warn(Warning::Other { text });
    *gpu = None;
    Painter::Cpu
}

/// What `work` makes with the painter; where that is a graphics card that fails and is not required, with the CPU from then on.
fn by<T>(
    painter: &mut Painter,
    gpu: &mut Option<String>,
    request: &RenderRequest,
    reporter: &Reporter,
    work: impl Fn(&mut Painter) -> Result<T, GpuError>,
) -> Result<T, Error> {
    match work(painter) {
        Err(error) if request.gpu != GpuChoice::Require => {
            *painter = by_cpu(gpu, &error, reporter);
            work(painter).map_err(gpu_failed)
        }
        done => done.map_err(gpu_failed),
    }
}

/// Refuses what cannot be drawn, before anything is read.
fn check(request: &RenderRequest) -> Result<(), Error> {
    let usage = |what: String| Err(Error::Usage { what });
    let [width, height] = request.size_px;
    if !SIZES_PX.contains(&width) || !SIZES_PX.contains(&height) {
        let (least, most) = (SIZES_PX.start(), SIZES_PX.end());
        return usage(format!("--size {width}x{height}: give {least} to {most} pixels each way"));
    }
    let samples = u64::from(width) * u64::from(height) * u64::from(request.finer.pow(2));
    if samples > MOST_SAMPLES {
        return usage(format!(
            "--size {width}x{height} with --samples {} makes {} million samples; give a smaller size or fewer samples (at most {} million)",
            request.finer,
            samples / 1_000_000,
            MOST_SAMPLES / 1_000_000
        ));
    }
    if request.turntable.is_some() && request.view != ViewRequest::Overview {
        return usage("--turntable turns the overview; leave out --view and --camera".to_owned());
    }
    if let ViewRequest::Placed { eye, aim: Aim::Place(target), .. } = request.view
        && eye == target
    {
        return usage("--look-at is where the camera stands; give another place".to_owned());
    }
    Ok(())
}

/// Files of the frames.
fn frame_files(request: &RenderRequest) -> Result<Vec<PathBuf>, Error> {
    let output = &request.output;
    let usage = |what: &str| Error::Usage { what: format!("{}: {what}", output.display()) };
    let is_png = output.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png"));
    if !is_png {
        return Err(usage("pictures are PNG files; give a name that ends in .png"));
    }
    let Some(frames) = request.turntable else { return Ok(vec![output.clone()]) };
    let stem = output.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let name = |number: u16| output.with_file_name(format!("{stem}_{number:03}.png"));
    Ok((0..frames).map(name).collect())
}

/// Pictures under way: all frames arrive, or none.
struct Pictures<'a> {
    files: &'a [PathBuf],
    staging: TempDir,
}

impl<'a> Pictures<'a> {
    fn begin(files: &'a [PathBuf]) -> Result<Self, Error> {
        let begin = |file: &PathBuf| {
            scene::staging(std::path::absolute(file)?.parent().unwrap_or(Path::new(".")))
        };
        let staging = files.first().map_or_else(tempfile::tempdir, begin);
        let fail =
            |source| write_error(files.first().map_or(Path::new("."), PathBuf::as_path), source);
        Ok(Self { files, staging: staging.map_err(fail)? })
    }

    fn staged(&self, number: usize) -> PathBuf {
        self.staging.path().join(format!("{number}.png"))
    }

    fn write(&mut self, number: usize, png: &[u8]) -> Result<(), Error> {
        fs::write(self.staged(number), png).map_err(|e| write_error(&self.files[number], e))
    }

    fn commit(self) -> Result<(), Error> {
        for (number, file) in self.files.iter().enumerate() {
            fs::rename(self.staged(number), file).map_err(|e| write_error(file, e))?;
        }
        Ok(())
    }
}

type Fields = [Option<Grid<f32>>; 3];

/// What is drawn, the elevation of the whole scene, and grass, litterfall and dryness of its ground.
fn read(
    request: &RenderRequest,
    manifest: &Manifest,
    reporter: &Reporter,
) -> Result<(Selection, Grid<f32>, Fields), Error> {
    let folder = &request.folder;
    let scene = read_scene(folder, manifest, reporter)?;
    // places of plants count from the whole scene's corner
    let whole_m = scene.elevation_m.clone();
    let fields = [
        field(folder, "grass.tif", 0, &whole_m)?,
        field(folder, "litterfall.tif", 0, &whole_m)?,
        driest_month(folder, manifest, &whole_m)?,
    ];
    reporter.check_cancelled()?;
    let mut filter = request.filter.clone();
    if request.view == ViewRequest::Profile && filter.bbox.is_none() {
        filter.bbox = Some(transect(whole_m.frame()));
    }
    Ok((Selection::new(scene, &filter)?, whole_m, fields))
}

/// A strip from west to east through the scene's middle.
fn transect(frame: &Frame) -> MapWindow {
    let GeoTransform { cell_m, .. } = frame.transform;
    let middle = frame.middle();
    let half_m = 0.5 * SECTION_WIDTH_M.min(frame.cols as f64 * cell_m);
    let deep_m = 0.5 * SECTION_DEPTH_M.max(2.0 * cell_m);
    MapWindow {
        west: middle.east_m - half_m,
        south: middle.north_m - deep_m,
        east: middle.east_m + half_m,
        north: middle.north_m + deep_m,
    }
}

/// A band of a raster on the terrain's cells, `None` where the scene has none.
fn field(
    folder: &Path,
    file: &str,
    band: usize,
    elevation_m: &Grid<f32>,
) -> Result<Option<Grid<f32>>, Error> {
    let path = folder.join(file);
    if !path.exists() {
        return Ok(None);
    }
    let raster = raster_file::read_band(&path, band, &Limits::default())?;
    let frame = elevation_m.frame();
    if (raster.rows, raster.cols) != (frame.rows, frame.cols) {
        let problem = format!("{file} has another size than the terrain");
        return Err(scene::Error::Manifest { path, problem }.into());
    }
    Ok(Some(Grid::new(frame.clone(), Mask::new(raster.valid).into(), raster.values)))
}

/// How dry grass is in July, or in January south of the equator: 0 green to 1 straw.
fn driest_month(
    folder: &Path,
    manifest: &Manifest,
    elevation_m: &Grid<f32>,
) -> Result<Option<Grid<f32>>, Error> {
    let band = if manifest.scene.latitude_rad < 0.0 { 0 } else { 6 };
    let moisture_mm = field(folder, "moisture.tif", band, elevation_m)?;
    Ok(moisture_mm.map(|grid| {
        let dryness = |mm: &f32| math::smoothstep((GREEN_MM - mm) / (GREEN_MM - STRAW_MM));
        let values = grid.values().iter().map(dryness).collect();
        grid.with_values(values)
    }))
}

/// Direction to the sun.
fn sun(request: &RenderRequest, manifest: &Manifest) -> Vec3 {
    let [azimuth_rad, elevation_rad] = request.sun_rad.unwrap_or_else(|| {
        let head = &manifest.scene;
        let north = head.latitude_rad >= 0.0;
        // the same season on both halves of the Earth
        let day = if north { SUN_DAY } else { SUN_DAY + 182 };
        let at = solar::sun_position(head.latitude_rad, solar::declination_rad(day), SUN_HOUR);
        let azimuth = at.azimuth_rad - head.grid_convergence_rad;
        // angles need no more digits
        [azimuth as f32, at.elevation_rad.max(LEAST_SUN_RAD) as f32]
    });
    let level = math::cos(elevation_rad);
    vec3(math::sin(azimuth_rad) * level, math::cos(azimuth_rad) * level, math::sin(elevation_rad))
}

/// The camera of a view.
fn camera(
    request: &RenderRequest,
    world: &World<'_>,
    sun: Vec3,
    origin: [f64; 3],
    turned_rad: f32,
) -> Camera {
    let size_px = request.size_px.map(|px| px as f32); // below 2²⁴
    let ground = &world.ground;
    let tallest_m = world.tallest_m;
    // pictures are taken some km around
    let place = |p: [f64; 3]| {
        vec3((p[0] - origin[0]) as f32, (p[1] - origin[1]) as f32, (p[2] - origin[2]) as f32)
    };
    match request.view {
        ViewRequest::Overview => {
            view::overview(ground, tallest_m, view::AERIAL_AZIMUTH_RAD + turned_rad, size_px)
        }
        ViewRequest::ForestFloor => view::forest_floor(ground, world.instances, sun, size_px),
        ViewRequest::Profile => view::profile(ground, tallest_m, size_px),
        ViewRequest::Map => view::map(ground, tallest_m, size_px),
        ViewRequest::Placed { eye, aim, fov_rad } => {
            let eye = place(eye);
            let [azimuth_rad, pitch_rad] = match aim {
                Aim::Angles(angles_rad) => angles_rad,
                Aim::Place(target) => direction_angles(eye, place(target)),
            };
            Camera::perspective(eye, azimuth_rad, pitch_rad, fov_rad, size_px)
        }
    }
}

/// One picture.
fn take(
    request: &RenderRequest,
    world: &World<'_>,
    light: &Lighting,
    camera: &Camera,
    painter: &mut Painter,
) -> Result<RgbImage, GpuError> {
    let has_air = camera.is_perspective();
    let lights = Lights {
        sky: &light.sky,
        shadows: &light.shadows,
        sky_light: &light.sky_light,
        has_air,
        clear_m: clear_m(world, camera),
    };
    let options = PictureOptions {
        size_px: request.size_px,
        finer: request.finer,
        has_walls: request.view != ViewRequest::Map,
        // grass and litter have no figures
        is_strewn: request.colour == Colour::Natural
            && (!is_far(world, camera) || request.view == ViewRequest::Profile),
        has_fixed_sky: is_far(world, camera),
        exposure: None,
    };
    let picture = picture::take(world, &lights, camera, &options, painter)?;
    Ok(match camera.projection {
        Projection::Perspective { .. } => picture,
        Projection::Orthographic { px_per_m } => {
            let mut canvas = Canvas::from_image(picture);
            let foot = request.size_px[1].saturating_sub(26);
            let m_per_px = 1.0 / f64::from(px_per_m);
            // a plate, or the letters would be lost among crowns
            let plate = Rect { x: 10, y: foot.saturating_sub(32), width: 320, height: 50 };
            canvas.paint(plate, |_, _| furniture::PAPER);
            furniture::scale_bar(&mut canvas, &Lettering::default(), [24, foot], m_per_px);
            canvas.into_image()
        }
    })
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    #[test]
    fn the_cpu_goes_on_where_a_card_fails_unless_one_is_required() {
        let scene = || RenderRequest::new("forest".into(), "a.png".into(), ViewRequest::Map);
        for choice in GpuChoice::ALL {
            let request = RenderRequest { gpu: choice, ..scene() };
            let reporter = Reporter::silent();
            let (mut painter, mut gpu) = (Painter::Cpu, Some("Card".to_owned()));
            let tries = Cell::new(0);
            let done = by(&mut painter, &mut gpu, &request, &reporter, |_| {
                tries.set(tries.get() + 1);
                let problem = "gone".to_owned();
                let lost = GpuError::Lost { adapter: "Card".to_owned(), problem };
                if tries.get() == 1 { Err(lost) } else { Ok(tries.get()) }
            });
            if choice == GpuChoice::Require {
                assert!(done.unwrap_err().to_string().contains("Card: the graphics card was lost"));
                assert_eq!((tries.get(), reporter.warnings().len()), (1, 0));
            } else {
                assert_eq!((done.unwrap(), gpu, reporter.warnings().len()), (2, None, 1));
            }
        }
    }
}
