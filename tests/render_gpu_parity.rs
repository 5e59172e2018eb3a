//! Pictures by a graphics card show what those by the CPU show: nearly all samples the same surface of the same item, and depth maps the same
//! depths. Without an adapter the tests say "skipped: no adapter"; `REQUIRE_GPU=1` turns that into a failure. A software adapter will do.
#![cfg(feature = "gpu")]

use std::collections::BTreeMap;
use std::f32::consts::FRAC_PI_2;
use std::path::PathBuf;
use std::time::Instant;

use wildwood::export::instances::Instances;
use wildwood::export::render::camera::Camera;
use wildwood::export::render::coverage::Window;
use wildwood::export::render::draw_list;
use wildwood::export::render::ground::{Field, Ground};
use wildwood::export::render::lighting::Lighting;
use wildwood::export::render::painter::Painter;
use wildwood::export::render::picture::{self, PictureOptions, Sight};
use wildwood::export::render::picture_gpu::{GpuPainter, Texts};
use wildwood::export::render::shading::Lights;
use wildwood::export::render::shadow;
use wildwood::export::render::sky::Sky;
use wildwood::export::render::surface_buffer::{Sample, Surface};
use wildwood::export::render::vector::{UP, Vec3, vec3};
use wildwood::export::render::world::{Season, World};
use wildwood::gpu::Device;
use wildwood::math;
use wildwood::pipeline::render::{self, RenderRequest, ViewRequest};
use wildwood::plants::deadwood::{Cause, DownedLogKind, DownedLogs, Snags};
use wildwood::plants::{Layer, Plants};
use wildwood::progress::Reporter;
use wildwood::raster::Grid;
use wildwood::species::Biome;
use wildwood::tree::mesh::Material;

/// Any adapter, or `None` where there is none and none is required.
fn device() -> Option<Device> {
    let device = Device::open_for_tests().expect("an adapter that cannot be opened");
    match &device {
        Some(device) => eprintln!("on {}", device.adapter()),
        None if std::env::var_os("REQUIRE_GPU").is_some() => panic!("no adapter"),
        None => eprintln!("skipped: no adapter"),
    }
    device
}

/// Side of the ground, m.
const SIDE_M: f32 = 120.0;
const ORIGIN: [f64; 3] = [60.0, 60.0, 500.0];

fn fraction(i: usize, step: usize) -> f32 {
    (i * step % 65_521) as f32 / 65_521.0
}

/// Hilly ground with a hole in it.
fn elevation_m() -> Grid<f32> {
    let at = |row: usize, col: usize| {
        let (x, y) = (col as f32, row as f32);
        500.0 + 4.0 * math::sin(0.06 * x) + 3.0 * math::cos(0.05 * y + 0.4)
    };
    Grid::from_fn(120, 120, 1.0, |cell| {
        let is_hole = (90..94).contains(&cell.row) && (20..26).contains(&cell.col);
        if is_hole { f32::NAN } else { at(cell.row, cell.col) }
    })
}

/// A wood of all species and sizes.
fn instances(biome: &Biome, ground: &Grid<f32>) -> Instances {
    let mut plants = Plants::default();
    for i in 0..1100 {
        let index = i % biome.species.len();
        let species = &biome.species[index];
        let height_m = 0.1 + fraction(i, 37) * 0.8 * species.max_height_m;
        plants.id.push(i as u64);
        plants.species.push(index as u16);
        plants.layer.push(if height_m > 5.0 { Layer::Canopy } else { Layer::Undergrowth });
        plants.east_m.push(SIDE_M * fraction(i, 7919));
        plants.north_m.push(SIDE_M * fraction(i, 104_729));
        plants.z_m.push(500.0);
        plants.height_m.push(height_m);
        plants.crown_radius_m.push(species.crown_radius_m(height_m));
        plants.dbh_m.push(species.dbh_m(height_m));
        plants.age_years.push(50.0);
        plants.vigor.push(1.0);
    }
    let mut snags = Snags::default();
    let mut logs = DownedLogs::default();
    for i in 0..80 {
        snags.id.push(i as u64);
        snags.species.push(9 + (i % 7) as u16);
        snags.east_m.push(SIDE_M * fraction(i, 15_485));
        snags.north_m.push(SIDE_M * fraction(i, 32_452));
        snags.z_m.push(500.0);
        snags.height_m.push([20.0, 12.0, 0.8][i % 3]);
        snags.height_at_death_m.push(20.0);
        snags.dbh_m.push(0.4);
        snags.years_dead.push(5.0);
        snags.decay_class.push(1 + (i % 5) as u8);
        snags.density_fraction.push(0.8);
        snags.branch_fraction.push(0.5);
        snags.cause.push(Cause::Age);
        logs.id.push(i as u64);
        logs.parent_id.push(i as u64);
        logs.species.push(9 + (i % 7) as u16);
        logs.kind.push(DownedLogKind::ALL[i % 4]);
        // some lie across the southern edge
        logs.east_m.push(SIDE_M * fraction(i, 49_979));
        logs.north_m.push(if i % 4 == 0 { 1.0 } else { SIDE_M * fraction(i, 67_867) });
        logs.z_m.push(500.0);
        logs.length_m.push(9.0);
        logs.diameter_base_m.push(0.5);
        logs.diameter_tip_m.push(0.2);
        logs.azimuth_rad.push(3.1 + 0.1 * i as f32);
        logs.years_down.push(4.0);
        logs.decay_class.push(1 + (i % 5) as u8);
        logs.density_fraction.push(0.8);
        logs.cause.push(Cause::Age);
    }
    Instances::of(&plants, &snags, &logs, ground, biome, ORIGIN)
}

struct Wood {
    biome: Biome,
    elevation_m: Grid<f32>,
    instances: Instances,
}

impl Wood {
    fn new() -> Self {
        let biome = Biome::builtin("sonoma").unwrap();
        let elevation_m = elevation_m();
        let instances = instances(&biome, &elevation_m);
        Self { biome, elevation_m, instances }
    }

    fn world(&self, season: Season) -> World<'_> {
        let mut ground = Ground::new(&self.elevation_m, ORIGIN);
        let patchy = |high: f32| {
            let grid = Grid::from_fn(120, 120, 1.0, |cell| {
                high * ((cell.row / 7 + cell.col / 5) % 3) as f32 / 2.0
            });
            Some(Field::new(&grid, ORIGIN, 0.0))
        };
        (ground.grass_m, ground.litterfall) = (patchy(0.4), patchy(0.8));
        World::new(&self.instances, ground, &self.biome, [&[], &[]], season)
    }
}

const SIZE_PX: [u32; 2] = [240, 136];
const OPTIONS: PictureOptions = PictureOptions {
    size_px: SIZE_PX,
    finer: 1,
    has_walls: true,
    is_strewn: true,
    has_fixed_sky: false,
    exposure: None,
};

/// Cameras that see all kinds of things: obliquely, from afar, from among the trees, from above and from the side.
fn cameras() -> [(&'static str, Camera, Season); 5] {
    let size = SIZE_PX.map(|side| side as f32);
    let camera = |eye: [f32; 3], azimuth_rad: f32, pitch_rad: f32, fov_rad: f32| {
        Camera::perspective(eye.into(), azimuth_rad, pitch_rad, fov_rad, size)
    };
    let floor = camera([3.0, -9.0, -2.4], 0.5, -0.25, 1.1);
    let map = Camera::orthographic(vec3(0.0, 0.0, 80.0), 0.0, -FRAC_PI_2, 1.1, size);
    let profile = Camera::orthographic(vec3(0.0, -90.0, 12.0), 0.0, 0.0, 2.1, size);
    [
        ("oblique", camera([-110.0, -150.0, 130.0], 0.62, -0.62, 0.8), Season::Summer),
        ("far", camera([-300.0, -320.0, 260.0], 0.75, -0.54, 0.3), Season::Autumn),
        ("floor", floor, Season::Winter),
        ("map", map, Season::Summer),
        ("profile", profile, Season::Summer),
    ]
}

fn whole(tiles: Vec<(Window, Vec<Sample>)>) -> Vec<Sample> {
    let [width, height] = SIZE_PX;
    let mut all = vec![None; (width * height) as usize];
    for (window, samples) in tiles {
        for (i, sample) in samples.into_iter().enumerate() {
            let row = window.top as usize + i / window.width();
            let col = window.left as usize + i % window.width();
            let place = &mut all[row * width as usize + col];
            assert!(place.is_none(), "row {row}, column {col} came twice");
            *place = Some(sample);
        }
    }
    all.into_iter().map(|sample| sample.expect("windows fill the picture")).collect()
}

fn kind(sample: &Sample) -> &'static str {
    match sample.surface {
        Surface::Sky => "sky",
        Surface::Ground => "ground",
        Surface::Wall => "wall",
        Surface::Grass => "grass",
        Surface::Litter => "litter",
        Surface::Part(Material::Foliage) => "foliage",
        Surface::Part(_) => "stems",
    }
}

fn is_same(a: &Sample, b: &Sample) -> bool {
    let is_part = matches!(a.surface, Surface::Part(_));
    a.surface == b.surface && (!is_part || a.item == b.item)
}

/// Samples of the CPU's picture by kind, and how many of each the other shows too.
#[derive(Default)]
struct Tally(BTreeMap<&'static str, [usize; 2]>);

impl Tally {
    fn add(&mut self, cpu: &[Sample], gpu: &[Sample]) {
        for (c, g) in cpu.iter().zip(gpu) {
            let [all, same] = self.0.entry(kind(c)).or_default();
            *all += 1;
            *same += usize::from(is_same(c, g));
        }
    }

    /// The kinds of which the other shows too few.
    fn missed(&self) -> Vec<String> {
        let share = |[all, same]: [usize; 2]| same as f64 / all as f64;
        // leaves are a few samples wide: more of theirs lie at edges, which are rounded otherwise
        let least = |kind: &str| if kind == "foliage" { LEAST_FOLIAGE } else { LEAST_SOLID };
        let missed = self.0.iter().filter(|(kind, counts)| share(**counts) < least(kind));
        missed.map(|(kind, [all, same])| format!("{kind}: {same} of {all}")).collect()
    }
}

/// Least share of samples that show the same item and surface. Measured: 99.9 % of leaves, more of all else.
const LEAST_FOLIAGE: f64 = 0.99;
const LEAST_SOLID: f64 = 0.995;

fn samples(painter: Option<&mut GpuPainter>, world: &World<'_>, camera: &Camera) -> Vec<Sample> {
    let items = draw_list::visible(world.instances, &world.bounds, camera, &picture::DETAIL);
    let sight = Sight { world, camera, items: &items, options: &OPTIONS };
    let keep = |_: Window, samples: &[Sample]| samples.to_vec();
    whole(match painter {
        None => picture::surfaces(&sight, keep),
        Some(painter) => painter.surfaces(&sight, keep).unwrap(),
    })
}

/// A quarter of a picture.
const BAND_SAMPLES: usize = 8_000;

#[test]
fn pictures_show_the_same_surfaces() {
    let Some(device) = device() else { return };
    let mut painter = GpuPainter::new(&device).unwrap();
    let mut banding = GpuPainter::new(&device).unwrap().with_most_samples(BAND_SAMPLES);
    let wood = Wood::new();
    let mut all = Tally::default();
    for (name, camera, season) in cameras() {
        let world = wood.world(season);
        let cpu = samples(None, &world, &camera);
        let gpu = samples(Some(&mut painter), &world, &camera);
        let mut tally = Tally::default();
        tally.add(&cpu, &gpu);
        eprintln!("{name}: {:?}", tally.0);
        all.add(&cpu, &gpu);
        let mut in_bands = Tally::default();
        in_bands.add(&gpu, &samples(Some(&mut banding), &world, &camera));
        assert_eq!(in_bands.missed(), [""; 0], "{name} in bands");
        // what is the same is as near, faces the same way and is as open
        let same: Vec<_> = cpu.iter().zip(&gpu).filter(|(c, g)| is_same(c, g)).collect();
        let is_alike = |c: &Sample, g: &Sample| {
            let (place, other) = (c.nearness, g.nearness);
            let is_near = place == other || (place - other).abs() < 2e-3 * place.abs().max(0.05);
            let turn = c.normal.normalize_or(UP).dot(g.normal.normalize_or(UP));
            is_near && turn > 0.98 && c.openness.abs_diff(g.openness) < 3
        };
        let alike = same.iter().filter(|(c, g)| is_alike(c, g)).count();
        assert!(alike as f64 > 0.985 * same.len() as f64, "{name}: {alike} of {}", same.len());
    }
    assert_eq!(all.missed(), [""; 0]);
    let kinds: Vec<&str> = all.0.keys().copied().collect();
    assert_eq!(kinds, ["foliage", "grass", "ground", "litter", "sky", "stems", "wall"]);
}

#[test]
fn pictures_are_as_bright_and_the_same_in_bands_and_twice() {
    let Some(device) = device() else { return };
    let wood = Wood::new();
    let [(_, camera, season), ..] = cameras();
    let world = wood.world(season);
    let by = |painter: &mut Painter| {
        let sky = Sky::new(vec3(0.5, -0.4, 0.7).normalize_or(UP), 1.0);
        let light = Lighting::new(&world, sky, &camera, painter).unwrap();
        let Lighting { sky, shadows, sky_light } = &light;
        let lights = Lights { sky, shadows, sky_light, has_air: true, clear_m: 0.0 };
        let image = picture::take(&world, &lights, &camera, &OPTIONS, painter).unwrap();
        image.into_raw()
    };
    let card = |samples: usize| {
        let painter = GpuPainter::new(&device).unwrap().with_most_samples(samples);
        by(&mut Painter::Gpu(Box::new(painter)))
    };
    let (cpu, gpu) = (by(&mut Painter::Cpu), card(usize::MAX));
    let mean = |bytes: &[u8]| bytes.iter().map(|b| f64::from(*b)).sum::<f64>() / bytes.len() as f64;
    assert!((mean(&cpu) - mean(&gpu)).abs() < 0.25, "{} and {}", mean(&cpu), mean(&gpu));
    let apart = cpu.iter().zip(&gpu).filter(|(c, g)| c.abs_diff(**g) > 12).count();
    assert!(apart < cpu.len() / 100, "{apart} of {} bytes differ", cpu.len());
    assert!(gpu == card(usize::MAX), "one run and another differ");
    let banded = card(1 << 20);
    let apart = banded.iter().zip(&gpu).filter(|(c, g)| c.abs_diff(**g) > 12).count();
    assert!(apart < cpu.len() / 200, "{apart} of {} bytes differ in bands", cpu.len());
}

const MAP_SIDE_PX: u32 = 400;

/// Share of texels of a depth map by the card that are as deep as by the CPU, and whether any lies beside the terrain.
fn as_deep(
    painter: &mut GpuPainter,
    world: &World<'_>,
    middle: Vec3,
    radius_m: f32,
) -> (f64, bool) {
    let px_per_m = MAP_SIDE_PX as f32 / (2.0 * radius_m);
    let size = [MAP_SIDE_PX as f32; 2];
    let camera = Camera::orthographic(middle, 2.4, -0.7, px_per_m, size);
    let items = draw_list::visible(world.instances, &world.bounds, &camera, &shadow::DETAIL);
    let texel_m = 1.0 / px_per_m;
    let cpu = shadow::nearness(world, &camera, &items, MAP_SIDE_PX, texel_m);
    let gpu = painter.depth_map(world, &camera, &items, MAP_SIDE_PX, texel_m).unwrap();
    let is_same = |(c, g): &(&f32, &f32)| c == g || (**c - **g).abs() < 0.02;
    let same = cpu.iter().zip(&gpu).filter(is_same).count();
    (same as f64 / cpu.len() as f64, cpu.contains(&f32::NEG_INFINITY))
}

const LEAST_AS_DEEP: f64 = 0.995;

#[test]
fn depth_maps_are_as_deep() {
    let Some(device) = device() else { return };
    let mut painter = GpuPainter::new(&device).unwrap();
    let wood = Wood::new();
    let world = wood.world(Season::Summer);
    for (middle, radius_m) in [(vec3(0.0, 0.0, 8.0), 95.0), (vec3(10.0, -5.0, 2.0), 14.0)] {
        let (share, is_beside) = as_deep(&mut painter, &world, middle, radius_m);
        eprintln!("{radius_m} m: {share}");
        assert!(share > LEAST_AS_DEEP, "{share} of the texels");
        assert!(is_beside == (radius_m > 50.0));
    }
    let right = Texts::default();
    let gaps = right.shadow.replace("view.gap_threshold", "2.0 * view.gap_threshold");
    assert!(gaps != right.shadow, "the threshold is gone");
    let mut painter = GpuPainter::with_texts(&device, &Texts { shadow: gaps, ..right }).unwrap();
    let (share, _) = as_deep(&mut painter, &world, vec3(10.0, -5.0, 2.0), 14.0);
    assert!(share < LEAST_AS_DEEP, "twice the gaps went unnoticed: {share}");
}

#[test]
fn wrong_texts_are_noticed() {
    let Some(device) = device() else { return };
    let wood = Wood::new();
    let right = Texts::default();
    let swap = |text: &str, from: &str, to: &str| {
        assert!(text.contains(from), "{from} is gone");
        text.replace(from, to)
    };
    // other leaves, splats beside their places, ground too low, grass too dense
    let leaves = swap(&right.foliage, "hash2(s.word, k)", "hash2(s.word, k + 1u)");
    let splats = swap(&right.splat, "(abcd.yz - 0.5)", "(abcd.yz - 0.2)");
    let ground = swap(&right.ground, "heights[row * view.ground_cols + col]", "-9.0");
    let grass = swap(&right.strew, "s > chance", "s > chance + 0.5");
    let cases = [
        (0, Texts { foliage: leaves, ..right.clone() }),
        (1, Texts { splat: splats, ..right.clone() }),
        (0, Texts { ground, ..right.clone() }),
        (2, Texts { strew: grass, ..right.clone() }),
    ];
    for (number, (view, texts)) in cases.into_iter().enumerate() {
        let (name, camera, season) = cameras()[view];
        let world = wood.world(season);
        let mut painter = GpuPainter::with_texts(&device, &texts).unwrap();
        let mut tally = Tally::default();
        tally.add(&samples(None, &world, &camera), &samples(Some(&mut painter), &world, &camera));
        assert!(!tally.missed().is_empty(), "fault {number} went unnoticed, {name}: {:?}", tally.0);
    }
}

/// A scene's pictures by any adapter beside those by the CPU, and their seconds: `WILDWOOD_SCENE=forest WILDWOOD_PICTURES=folder cargo test
/// --test render_gpu_parity -- --ignored --nocapture`.
#[test]
#[ignore = "draws a scene of one's own"]
fn scenes_are_drawn_on_any_adapter() {
    let folder = |name: &str| PathBuf::from(std::env::var_os(name).expect(name));
    let (scene, pictures) = (folder("WILDWOOD_SCENE"), folder("WILDWOOD_PICTURES"));
    let Some(device) = device() else { return };
    let views = [("overview", ViewRequest::Overview), ("floor", ViewRequest::ForestFloor)];
    for (name, view) in views {
        for (by, device) in [("cpu", None), ("card", Some(&device))] {
            let output = pictures.join(format!("{name}_{by}.png"));
            let request = RenderRequest::new(scene.clone(), output, view);
            let begun = Instant::now();
            let rendered = render::run_on(device, &request, &Reporter::silent()).unwrap();
            eprintln!("{name} by {by}: {:.1} s, {:?}", begun.elapsed().as_secs_f32(), rendered.gpu);
        }
    }
}
