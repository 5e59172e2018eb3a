//! `wildwood render`: pictures of a scene.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::json;

use super::{Outcome, ScenePart, Shared, terminal};
use crate::export::render::figures::Colour;
use crate::export::render::world::Season;
use crate::export::selection::Filter;
use crate::gpu::GpuChoice;
use crate::pipeline::Error;
use crate::pipeline::render::{self, Aim, RenderRequest, Rendered, ViewRequest};
use crate::progress::Reporter;

/// Field of view of a camera that gives none, degrees. chosen: a normal lens of 35 mm.
const FOV_DEG: f64 = 54.0;

/// What `wildwood render` takes.
#[derive(Args)]
pub struct RenderArguments {
    /// Scene folder with a forest, from wildwood grow or wildwood age.
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// PNG file that is written.
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    /// From where: obliquely from the air, from eye height at a good spot, a section from the side, or from above.
    #[arg(long, value_enum, default_value_t, conflicts_with = "camera")]
    view: ViewArgument,
    /// A camera of one's own: map coordinates, elevation in metres, azimuth, pitch (down negative) and field of view in degrees; azimuth
    /// and pitch are left out with --look-at.
    #[arg(
        long,
        value_name = "E,N,Z,AZIMUTH,PITCH[,FOV]",
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true
    )]
    camera: Option<Vec<f64>>,
    /// Where the camera looks to, in map coordinates.
    #[arg(
        long,
        value_name = "E,N,Z",
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true,
        requires = "camera"
    )]
    look_at: Option<Vec<f64>>,
    /// Width and height in pixels.
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    size: [u32; 2],
    /// Samples a pixel, each way.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=4))]
    samples: u32,
    /// Season: winter-deciduous plants turn in autumn and are bare in winter.
    #[arg(long, value_name = "SEASON", default_value = "summer", value_parser = season)]
    season: Season,
    /// What colours mean: natural, species, age, vigor or decay.
    #[arg(long, value_name = "WHAT", default_value = "natural", value_parser = colour)]
    colour: Colour,
    /// The sun, in degrees from grid north and over the horizon [default: a summer morning's at the scene's latitude].
    #[arg(
        long,
        value_name = "AZIMUTH,ELEVATION",
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true
    )]
    sun: Option<Vec<f64>>,
    /// How thick the haze is: 0 none, 1 a clear day, 10 mist.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = haze, allow_hyphen_values = true)]
    haze: f32,
    /// Graphics card: auto draws on one where there is one, require fails without. Pictures are the same but for single pixels.
    #[arg(long, value_name = "auto|off|require", default_value_t)]
    gpu: GpuChoice,
    #[command(flatten)]
    part: ScenePart,
    /// So many frames of a turn around the scene's middle: view_000.png, view_001.png … for -o view.png.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=999))]
    turntable: Option<u16>,
}

/// `--view` on the command line.
#[derive(Clone, Copy, Default, ValueEnum)]
enum ViewArgument {
    /// Obliquely from the air, the whole tile in sight.
    #[default]
    Overview,
    /// From eye height, at an open spot with tall trees and deadwood near.
    ForestFloor,
    /// A section from the side, with a scale bar.
    Profile,
    /// From above.
    Map,
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let problem = || "give width and height in pixels, as 1280x720".to_owned();
    let (width, height) = text.split_once('x').ok_or_else(problem)?;
    match (width.trim().parse(), height.trim().parse()) {
        (Ok(width), Ok(height)) => Ok([width, height]),
        _ => Err(problem()),
    }
}

fn season(text: &str) -> Result<Season, String> {
    Season::from_name(text).ok_or_else(|| {
        format!("no such season; give one of {}", Season::ALL.map(Season::name).join(", "))
    })
}

fn colour(text: &str) -> Result<Colour, String> {
    Colour::from_name(text)
        .ok_or_else(|| format!("give one of {}", Colour::ALL.map(Colour::name).join(", ")))
}

fn haze(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(haze) if (0.0..=100.0).contains(&haze) => Ok(haze),
        _ => Err("give a factor from 0 to 100".to_owned()),
    }
}

fn usage(what: &str) -> Error {
    Error::Usage { what: what.to_owned() }
}

/// The view that flags ask for.
fn view(arguments: &RenderArguments) -> Result<ViewRequest, Error> {
    let Some(numbers) = &arguments.camera else {
        return Ok(match arguments.view {
            ViewArgument::Overview => ViewRequest::Overview,
            ViewArgument::ForestFloor => ViewRequest::ForestFloor,
            ViewArgument::Profile => ViewRequest::Profile,
            ViewArgument::Map => ViewRequest::Map,
        });
    };
    let angle = |degrees: f64| degrees.to_radians() as f32; // angles need no more digits
    if !numbers.iter().all(|number| number.is_finite()) {
        return Err(usage("--camera: give finite numbers"));
    }
    let (eye, aim, fov_deg) = match (&arguments.look_at, &numbers[..]) {
        (None, &[e, n, z, azimuth, pitch, ref rest @ ..]) if rest.len() < 2 => {
            if !(-90.0..=90.0).contains(&pitch) {
                return Err(usage("--camera: pitch is −90 (down) to 90 degrees"));
            }
            ([e, n, z], Aim::Angles([angle(azimuth), angle(pitch)]), rest.first().copied())
        }
        (Some(target), &[e, n, z, ref rest @ ..]) if rest.len() < 2 => {
            let &[te, tn, tz] = &target[..] else {
                return Err(usage("--look-at takes three numbers: E,N,Z"));
            };
            ([e, n, z], Aim::Place([te, tn, tz]), rest.first().copied())
        }
        (None, _) => {
            return Err(usage("--camera takes five or six numbers: E,N,Z,AZIMUTH,PITCH[,FOV]"));
        }
        (Some(_), _) => {
            return Err(usage("--camera takes three or four numbers with --look-at: E,N,Z[,FOV]"));
        }
    };
    let fov_deg = fov_deg.unwrap_or(FOV_DEG);
    if !(1.0..=150.0).contains(&fov_deg) {
        return Err(usage("--camera: the field of view is 1 to 150 degrees"));
    }
    Ok(ViewRequest::Placed { eye, aim, fov_rad: angle(fov_deg) })
}

/// The sun that a flag asks for, rad.
fn sun(numbers: &[f64]) -> Result<[f32; 2], Error> {
    match *numbers {
        [azimuth, elevation] if azimuth.is_finite() && (1.0..=90.0).contains(&elevation) => {
            // angles need no more digits
            Ok([azimuth.to_radians() as f32, elevation.to_radians() as f32])
        }
        _ => Err(usage("--sun takes AZIMUTH,ELEVATION in degrees, the elevation from 1 to 90")),
    }
}

pub fn run(arguments: &RenderArguments, shared: &Shared, reporter: &Reporter) -> Outcome {
    let bbox = arguments.part.window()?;
    let request = RenderRequest {
        folder: arguments.folder.clone(),
        output: arguments.output.clone(),
        view: view(arguments)?,
        size_px: arguments.size,
        finer: arguments.samples,
        filter: Filter { bbox, ..Filter::default() },
        season: arguments.season,
        colour: arguments.colour,
        sun_rad: arguments.sun.as_deref().map(sun).transpose()?,
        haze: arguments.haze,
        turntable: arguments.turntable,
        gpu: arguments.gpu,
    };
    let rendered = render::run(&request, reporter)?;
    report(&rendered, shared);
    Ok(())
}

/// Says what was drawn, and from where.
fn report(rendered: &Rendered, shared: &Shared) {
    let files: Vec<String> = rendered.files.iter().map(|f| f.display().to_string()).collect();
    let [east_m, north_m, z_m] = rendered.eye;
    let [azimuth, pitch] = rendered.angles_rad.map(|rad| f64::from(rad).to_degrees());
    let azimuth = azimuth.rem_euclid(360.0);
    if shared.json {
        terminal::line(&json!({
            "event": "done",
            "files": files,
            "instances": rendered.instances,
            "gpu": rendered.gpu,
            "camera": [east_m, north_m, z_m, azimuth, pitch],
        }));
        return;
    }
    if shared.quiet {
        return;
    }
    let what = match &files[..] {
        [file] => file.clone(),
        [first, .., last] => format!("{first} … {last}"),
        [] => String::new(),
    };
    let from = match rendered.view {
        // parallel rays have no camera of one's own
        ViewRequest::Map | ViewRequest::Profile => String::new(),
        ViewRequest::Overview | ViewRequest::ForestFloor | ViewRequest::Placed { .. } => format!(
            "; taken from --camera {east_m:.1},{north_m:.1},{z_m:.1},{azimuth:.1},{pitch:.1}"
        ),
    };
    let count = rendered.instances;
    terminal::say(&format!("{what}: {count} plants, snags and downed logs{from}"));
}
