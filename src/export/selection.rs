//! What of a scene is exported: its tables and terrain, cut to a box, to layers and to a least height.

use std::sync::Arc;

use super::instances::FeatureTable;
use crate::plants::deadwood::{Deadwood, DownedLogs, Snags};
use crate::plants::{Layer, Plants};
use crate::raster::{Frame, GeoTransform, Grid, MapWindow, Mask};
use crate::species::Biome;

/// A layer of the forest, as a user names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ExportLayer {
    /// Trees of the canopy.
    Canopy,
    /// Plants beneath them.
    Undergrowth,
    /// Snags.
    Snags,
    /// Downed logs.
    DownedLogs,
}

impl ExportLayer {
    /// Every layer, in the order of files.
    pub const ALL: [Self; 4] = [Self::Canopy, Self::Undergrowth, Self::Snags, Self::DownedLogs];

    /// The layer's name in flags.
    pub fn name(self) -> &'static str {
        match self {
            Self::Canopy => "canopy",
            Self::Undergrowth => "undergrowth",
            Self::Snags => "snags",
            Self::DownedLogs => "logs",
        }
    }

    /// The layer of a name in a flag.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|layer| layer.name() == name)
    }

    /// The table that its features are rows of.
    pub fn table(self) -> FeatureTable {
        match self {
            Self::Canopy | Self::Undergrowth => FeatureTable::Plants,
            Self::Snags => FeatureTable::Snags,
            Self::DownedLogs => FeatureTable::DownedLogs,
        }
    }
}

/// What a user asks for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filter {
    /// Box in map coordinates; `None` is the whole scene. Its east and north edges are the next box's.
    pub bbox: Option<MapWindow>,
    /// Layers; `None` is all that the scene has.
    pub layers: Option<Vec<ExportLayer>>,
    /// Least height of plants and snags.
    pub min_height_m: f32,
}

/// All of a scene that can be selected.
#[derive(Clone, Debug)]
pub struct SceneContent {
    /// The scene's name.
    pub name: String,
    /// Its biome.
    pub biome: Biome,
    /// Its terrain.
    pub elevation_m: Grid<f32>,
    /// Its live plants.
    pub plants: Plants,
    /// What is dead in it; `None` if its forest has no history.
    pub deadwood: Option<Deadwood>,
}

/// What is exported: rows of tables, and the terrain that they stand on.
#[derive(Clone, Debug)]
pub struct Selection {
    /// The scene's name.
    pub name: String,
    /// The biome that species are of.
    pub biome: Biome,
    /// Size and place of the whole scene: rows' positions count from its south-west corner, whatever the box.
    pub frame: Arc<Frame>,
    /// Bounds of the selection in map coordinates: the box, at most the scene.
    pub window: MapWindow,
    /// Elevation of the ground on the cells that the window touches; its own frame says where they lie.
    pub elevation_m: Grid<f32>,
    /// Layers, in the order of [`ExportLayer::ALL`]; a layer may have no row within the box.
    pub layers: Vec<ExportLayer>,
    /// Live plants; none if neither of their layers is selected.
    pub plants: Plants,
    /// Snags; none if they are not selected.
    pub snags: Snags,
    /// Downed logs, by their thick ends; none if they are not selected.
    pub downed_logs: DownedLogs,
}

/// Why nothing can be exported.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum SelectionError {
    #[error(
        "--bbox {bbox} lies outside the scene, which reaches over {scene} (west, south, east, north)"
    )]
    OutsideScene { bbox: MapWindow, scene: MapWindow },
    #[error("the scene has no plants; grow a forest in it first (wildwood grow)")]
    NoPlants,
    #[error("--layers {layer}: the scene has none; it has {present}{hint}")]
    NoLayer { layer: &'static str, present: String, hint: &'static str },
    #[error(
        "nothing is selected: none of {of} lies within {window} (west, south, east, north){height}"
    )]
    Nothing { of: String, window: MapWindow, height: String },
}

impl Selection {
    /// The part of a scene that a filter asks for.
    ///
    /// # Errors
    /// [`SelectionError`] if the box lies outside, a layer is not there, or nothing is left.
    pub fn new(scene: SceneContent, filter: &Filter) -> Result<Self, SelectionError> {
        let frame = Arc::clone(scene.elevation_m.frame());
        let whole = bounds(&frame);
        let window = match filter.bbox {
            None => whole,
            Some(bbox) => bbox
                .intersection(&whole)
                .ok_or(SelectionError::OutsideScene { bbox, scene: whole })?,
        };
        let layers = layers(&scene, filter)?;
        let place = Place::new(&frame, &window, &whole);
        let Deadwood { mut snags, mut downed_logs } = scene.deadwood.unwrap_or_default();
        let mut plants = scene.plants;
        let of = counts(&plants, &snags, &downed_logs, &layers);

        let wanted = |layer: ExportLayer| layers.contains(&layer);
        let least_m = filter.min_height_m;
        let keep: Vec<bool> = (0..plants.len())
            .map(|i| {
                let layer = match plants.layer[i] {
                    Layer::Canopy => ExportLayer::Canopy,
                    Layer::Undergrowth => ExportLayer::Undergrowth,
                };
                wanted(layer)
                    && plants.height_m[i] >= least_m
                    && place.holds(plants.east_m[i], plants.north_m[i])
            })
            .collect();
        keep_plants(&mut plants, &keep);
        let keep: Vec<bool> = (0..snags.len())
            .map(|i| {
                wanted(ExportLayer::Snags)
                    && snags.height_m[i] >= least_m
                    && place.holds(snags.east_m[i], snags.north_m[i])
            })
            .collect();
        keep_snags(&mut snags, &keep);
        let keep: Vec<bool> = (0..downed_logs.len())
            .map(|i| {
                wanted(ExportLayer::DownedLogs)
                    && place.holds(downed_logs.east_m[i], downed_logs.north_m[i])
            })
            .collect();
        keep_downed_logs(&mut downed_logs, &keep);

        if plants.is_empty() && snags.is_empty() && downed_logs.is_empty() {
            let has_height = layers.iter().any(|layer| *layer != ExportLayer::DownedLogs);
            let height = if least_m > 0.0 && has_height {
                format!(" and is {least_m} m high or more; widen --bbox or lower --min-height")
            } else {
                "; widen --bbox or choose other --layers".to_owned()
            };
            return Err(SelectionError::Nothing { of, window, height });
        }
        Ok(Self {
            name: scene.name,
            biome: scene.biome,
            elevation_m: cut(&scene.elevation_m, &window),
            frame,
            window,
            layers,
            plants,
            snags,
            downed_logs,
        })
    }

    /// Tables that have a selected layer, in the order of files.
    pub fn tables(&self) -> Vec<FeatureTable> {
        let mut tables: Vec<FeatureTable> = self.layers.iter().map(|layer| layer.table()).collect();
        tables.dedup();
        tables
    }

    /// Number of rows of a table.
    pub fn rows(&self, table: FeatureTable) -> usize {
        match table {
            FeatureTable::Plants => self.plants.len(),
            FeatureTable::Snags => self.snags.len(),
            FeatureTable::DownedLogs => self.downed_logs.len(),
        }
    }

    /// Number of rows of all tables.
    pub fn len(&self) -> usize {
        self.plants.len() + self.snags.len() + self.downed_logs.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Bounds of a frame in map coordinates.
fn bounds(frame: &Frame) -> MapWindow {
    let GeoTransform { west_m, north_m, cell_m } = frame.transform;
    let south = frame.south_west().north_m;
    MapWindow { west: west_m, south, east: west_m + frame.cols as f64 * cell_m, north: north_m }
}

/// The layers that a scene has, in the order of [`ExportLayer::ALL`].
pub fn layers_of(scene: &SceneContent) -> Vec<ExportLayer> {
    let dead = scene.deadwood.as_ref();
    let is_present = |layer: &ExportLayer| match layer {
        ExportLayer::Canopy => scene.plants.layer.contains(&Layer::Canopy),
        ExportLayer::Undergrowth => scene.plants.layer.contains(&Layer::Undergrowth),
        ExportLayer::Snags => dead.is_some_and(|dead| !dead.snags.is_empty()),
        ExportLayer::DownedLogs => dead.is_some_and(|dead| !dead.downed_logs.is_empty()),
    };
    ExportLayer::ALL.into_iter().filter(is_present).collect()
}

/// The layers that are asked for.
fn layers(scene: &SceneContent, filter: &Filter) -> Result<Vec<ExportLayer>, SelectionError> {
    let present = layers_of(scene);
    if present.is_empty() {
        return Err(SelectionError::NoPlants);
    }
    let Some(asked) = &filter.layers else { return Ok(present) };
    if let Some(absent) = asked.iter().find(|layer| !present.contains(layer)) {
        let present: Vec<&str> = present.iter().map(|layer| layer.name()).collect();
        let hint = match absent.table() {
            FeatureTable::Plants => "",
            _ => " (wildwood age makes deadwood)",
        };
        let present = present.join(", ");
        return Err(SelectionError::NoLayer { layer: absent.name(), present, hint });
    }
    Ok(present.into_iter().filter(|layer| asked.contains(layer)).collect())
}

/// What there is of the layers before it is cut, in words.
fn counts(plants: &Plants, snags: &Snags, logs: &DownedLogs, layers: &[ExportLayer]) -> String {
    let of_layer = |layer: Layer| plants.layer.iter().filter(|other| **other == layer).count();
    let count = |layer: &ExportLayer| match layer {
        ExportLayer::Canopy => format!("{} canopy trees", of_layer(Layer::Canopy)),
        ExportLayer::Undergrowth => {
            format!("{} plants of undergrowth", of_layer(Layer::Undergrowth))
        }
        ExportLayer::Snags => format!("{} snags", snags.len()),
        ExportLayer::DownedLogs => format!("{} downed logs", logs.len()),
    };
    layers.iter().map(count).collect::<Vec<_>>().join(", ")
}

/// Where a box lies, in metres from the scene's south-west corner.
struct Place {
    east_m: [f64; 2],
    north_m: [f64; 2],
}

impl Place {
    /// Edges of the box that are the scene's are open: rows that lie on or beyond them have no other box.
    fn new(frame: &Frame, window: &MapWindow, whole: &MapWindow) -> Self {
        let corner = frame.south_west();
        let from = |edge: f64, of_scene: f64, corner_m: f64| {
            if edge <= of_scene { f64::NEG_INFINITY } else { edge - corner_m }
        };
        let to = |edge: f64, of_scene: f64, corner_m: f64| {
            if edge >= of_scene { f64::INFINITY } else { edge - corner_m }
        };
        Self {
            east_m: [
                from(window.west, whole.west, corner.east_m),
                to(window.east, whole.east, corner.east_m),
            ],
            north_m: [
                from(window.south, whole.south, corner.north_m),
                to(window.north, whole.north, corner.north_m),
            ],
        }
    }

    fn holds(&self, east_m: f32, north_m: f32) -> bool {
        let is_within = |at_m: f32, [from, to]: [f64; 2]| (from..to).contains(&f64::from(at_m));
        is_within(east_m, self.east_m) && is_within(north_m, self.north_m)
    }
}

/// The cells that a window touches.
fn cut(elevation_m: &Grid<f32>, window: &MapWindow) -> Grid<f32> {
    let frame = elevation_m.frame();
    let GeoTransform { west_m, north_m, cell_m } = frame.transform;
    // cells whose edge is the window's to a millionth of a cell are not touched
    let first = |from_edge: f64, cells: usize| {
        (((from_edge / cell_m + 1e-6).floor().max(0.0)) as usize).min(cells.saturating_sub(1)) // inside the frame
    };
    let end = |from_edge: f64, first: usize, cells: usize| {
        ((from_edge / cell_m - 1e-6).ceil() as usize).clamp(first + 1, cells) // inside the frame
    };
    let (top, left) =
        (first(north_m - window.north, frame.rows), first(window.west - west_m, frame.cols));
    let (bottom, right) =
        (end(north_m - window.south, top, frame.rows), end(window.east - west_m, left, frame.cols));
    let transform = GeoTransform {
        west_m: west_m + left as f64 * cell_m,
        north_m: north_m - top as f64 * cell_m,
        cell_m,
    };
    let (rows, cols) = (bottom - top, right - left);
    let mut values = Vec::with_capacity(rows * cols);
    let mut valid = Vec::with_capacity(rows * cols);
    for row in top..bottom {
        values.extend_from_slice(&elevation_m.row(row)[left..right]);
        valid.extend_from_slice(&elevation_m.mask().as_slice()[row * frame.cols..][left..right]);
    }
    let frame = Frame { rows, cols, transform, crs: frame.crs.clone() };
    Grid::new(Arc::new(frame), Arc::new(Mask::new(valid)), values)
}

/// Keeps the values whose rows are kept.
fn retain<T>(values: &mut Vec<T>, keep: &[bool]) {
    let mut rows = keep.iter();
    values.retain(|_| rows.next().copied().unwrap_or(false));
}

fn keep_plants(plants: &mut Plants, keep: &[bool]) {
    if keep.iter().all(|kept| *kept) {
        return;
    }
    retain(&mut plants.id, keep);
    retain(&mut plants.species, keep);
    retain(&mut plants.layer, keep);
    for values in [
        &mut plants.east_m,
        &mut plants.north_m,
        &mut plants.z_m,
        &mut plants.height_m,
        &mut plants.crown_radius_m,
        &mut plants.dbh_m,
        &mut plants.age_years,
        &mut plants.vigor,
    ] {
        retain(values, keep);
    }
}

fn keep_snags(snags: &mut Snags, keep: &[bool]) {
    if keep.iter().all(|kept| *kept) {
        return;
    }
    retain(&mut snags.id, keep);
    retain(&mut snags.species, keep);
    retain(&mut snags.decay_class, keep);
    retain(&mut snags.cause, keep);
    for values in [
        &mut snags.east_m,
        &mut snags.north_m,
        &mut snags.z_m,
        &mut snags.height_m,
        &mut snags.height_at_death_m,
        &mut snags.dbh_m,
        &mut snags.years_dead,
        &mut snags.density_fraction,
        &mut snags.branch_fraction,
    ] {
        retain(values, keep);
    }
}

fn keep_downed_logs(downed_logs: &mut DownedLogs, keep: &[bool]) {
    if keep.iter().all(|kept| *kept) {
        return;
    }
    retain(&mut downed_logs.id, keep);
    retain(&mut downed_logs.parent_id, keep);
    retain(&mut downed_logs.species, keep);
    retain(&mut downed_logs.kind, keep);
    retain(&mut downed_logs.decay_class, keep);
    retain(&mut downed_logs.cause, keep);
    for values in [
        &mut downed_logs.east_m,
        &mut downed_logs.north_m,
        &mut downed_logs.z_m,
        &mut downed_logs.length_m,
        &mut downed_logs.diameter_base_m,
        &mut downed_logs.diameter_tip_m,
        &mut downed_logs.azimuth_rad,
        &mut downed_logs.years_down,
        &mut downed_logs.density_fraction,
    ] {
        retain(values, keep);
    }
}
