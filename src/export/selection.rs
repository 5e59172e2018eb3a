//! What of a scene is exported: its tables and terrain, cut to a box, to layers and to a least height.

use std::sync::Arc;

use super::instances::FeatureTable;
use crate::io::table::Table;
use crate::plants::deadwood::{Deadwood, DownedLogs, Snags};
use crate::plants::{Layer, Plants, downed_logs_table, snags_table, table};
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
    /// Years that its forest was aged.
    pub years: u32,
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
    /// Years that the forest was aged.
    pub years: u32,
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
            years: scene.years,
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

    /// A table as files hold it, rows in the order of ids.
    pub fn table(&self, table: FeatureTable) -> Box<dyn Table + '_> {
        let Self { biome, frame, .. } = self;
        match table {
            FeatureTable::Plants => table::as_table(&self.plants, biome, frame),
            FeatureTable::Snags => snags_table::as_table(&self.snags, biome, frame),
            FeatureTable::DownedLogs => {
                downed_logs_table::as_table(&self.downed_logs, biome, frame)
            }
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

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::plants::deadwood::{Cause, DownedLogKind};
    use crate::raster::{Cell, Crs};

    /// Twenty metres of ground from (1000, 2000) with four plants, a snag and a downed log that begins beyond the edge.
    pub(in crate::export) fn scene() -> SceneContent {
        let transform = GeoTransform { west_m: 1000.0, north_m: 2020.0, cell_m: 2.0 };
        let frame = Frame { rows: 10, cols: 10, transform, crs: Crs::Epsg(32611) };
        let values = (0..100).map(|i| i as f32).collect();
        let mask = Arc::new(Mask::all_valid(100));
        let count = 4;
        let plants = Plants {
            id: vec![1, 2, 3, 4],
            species: vec![0, 1, 2, 3],
            layer: vec![Layer::Canopy, Layer::Undergrowth, Layer::Canopy, Layer::Undergrowth],
            east_m: vec![0.0, 9.5, 10.0, 20.0],
            north_m: vec![0.0, 10.0, 9.5, 20.0],
            z_m: vec![5.0; count],
            height_m: vec![20.0, 0.5, 8.0, 1.5],
            crown_radius_m: vec![3.0, 0.25, 2.0, 0.5],
            dbh_m: vec![0.5, 0.0, 0.25, 0.01],
            age_years: vec![80.0, 2.0, 30.0, 4.5],
            vigor: vec![0.5; count],
        };
        let snags = Snags {
            id: vec![9],
            species: vec![1],
            east_m: vec![15.0],
            north_m: vec![5.0],
            z_m: vec![5.0],
            height_m: vec![4.0],
            height_at_death_m: vec![12.0],
            dbh_m: vec![0.25],
            years_dead: vec![3.0],
            decay_class: vec![2],
            density_fraction: vec![0.75],
            branch_fraction: vec![0.5],
            cause: vec![Cause::Storm],
        };
        let downed_logs = DownedLogs {
            id: vec![17],
            parent_id: vec![5],
            species: vec![0],
            kind: vec![DownedLogKind::Trunk],
            east_m: vec![-3.0],
            north_m: vec![5.0],
            z_m: vec![4.5],
            length_m: vec![8.0],
            diameter_base_m: vec![0.5],
            diameter_tip_m: vec![0.125],
            azimuth_rad: vec![std::f32::consts::FRAC_PI_2],
            years_down: vec![1.0],
            decay_class: vec![1],
            density_fraction: vec![0.9],
            cause: vec![Cause::Storm],
        };
        SceneContent {
            name: "forest".to_owned(),
            biome: Biome::builtin("pyrenees").unwrap(),
            elevation_m: Grid::new(Arc::new(frame), mask, values),
            plants,
            deadwood: Some(Deadwood { snags, downed_logs }),
            years: 30,
        }
    }

    fn select(filter: &Filter) -> Result<Selection, SelectionError> {
        Selection::new(scene(), filter)
    }

    fn boxed(west: f64, south: f64, east: f64, north: f64) -> Filter {
        Filter { bbox: Some(MapWindow { west, south, east, north }), ..Filter::default() }
    }

    #[test]
    fn everything_is_the_default() {
        let all = select(&Filter::default()).unwrap();
        assert_eq!((all.len(), all.layers), (6, ExportLayer::ALL.to_vec()));
        assert_eq!((all.plants, all.elevation_m.frame().len()), (scene().plants, 100));
    }

    #[test]
    fn boxes_side_by_side_share_nothing_and_lose_nothing() {
        let mut ids = Vec::new();
        for (west, south) in
            [(1000.0, 2000.0), (1010.0, 2000.0), (1000.0, 2010.0), (1010.0, 2010.0)]
        {
            let part = select(&boxed(west, south, west + 10.0, south + 10.0)).unwrap();
            ids.extend(part.plants.id);
            ids.extend(part.snags.id);
            ids.extend(part.downed_logs.id);
        }
        ids.sort_unstable();
        assert_eq!(ids, [1, 2, 3, 4, 9, 17]);
        // just right of the middle, in the south-east
        let south_east = select(&boxed(1010.0, 2000.0, 1020.0, 2010.0)).unwrap();
        assert_eq!(south_east.plants.id, [3]);
    }

    #[test]
    fn terrain_is_cut_to_the_cells_that_the_box_touches() {
        let part = select(&boxed(1003.0, 2000.0, 1010.0, 2011.0)).unwrap();
        let frame = part.elevation_m.frame();
        assert_eq!((frame.rows, frame.cols), (6, 4));
        assert_eq!((frame.transform.west_m, frame.transform.north_m), (1002.0, 2012.0));
        assert_eq!(part.elevation_m[Cell { row: 0, col: 0 }], 41.0);
        assert_eq!(part.frame.len(), 100, "positions count from the scene's corner");
    }

    #[test]
    fn layers_and_heights_are_left_out() {
        let layers = Some(vec![ExportLayer::Snags, ExportLayer::Canopy]);
        let some = select(&Filter { layers, min_height_m: 8.0, bbox: None }).unwrap();
        assert_eq!((some.plants.id.as_slice(), some.len()), (&[1, 3][..], 2));
        assert_eq!(some.tables(), [FeatureTable::Plants, FeatureTable::Snags]);
        let layers = Some(vec![ExportLayer::DownedLogs]);
        let logs = select(&Filter { layers, min_height_m: 50.0, bbox: None }).unwrap();
        assert_eq!((logs.downed_logs.len(), logs.len()), (1, 1), "they have no height");
    }

    #[test]
    fn what_selects_nothing_is_refused() {
        let told = |filter: &Filter| select(filter).unwrap_err().to_string();
        assert!(told(&boxed(0.0, 0.0, 5.0, 5.0)).contains("outside the scene"));
        let empty = told(&boxed(1004.0, 2014.0, 1006.0, 2016.0));
        assert!(empty.contains("none of 2 canopy trees, 2 plants of undergrowth"), "{empty}");
        let layers = Some(vec![ExportLayer::Canopy]);
        let high = told(&Filter { layers: layers.clone(), min_height_m: 50.0, bbox: None });
        assert!(high.contains("50 m high or more"), "{high}");

        let mut young = scene();
        young.deadwood = None;
        let layers = Some(vec![ExportLayer::Snags]);
        let filter = Filter { layers, ..Filter::default() };
        let error = Selection::new(young, &filter).unwrap_err().to_string();
        assert!(error.contains("it has canopy, undergrowth (wildwood age"), "{error}");

        let mut bare = scene();
        (bare.plants, bare.deadwood) = (Plants::default(), None);
        assert_eq!(Selection::new(bare, &Filter::default()).unwrap_err(), SelectionError::NoPlants);
    }
}
