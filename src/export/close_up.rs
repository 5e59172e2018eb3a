//! A close-up: what grows on a square of the scene, from above and from the side, so that a forester can judge what
//! stands under the canopy.
//!
//! Reading order: [`area`] (the square); `plan` (from above) with `ground` and `symbols`; `profile` (from the side)
//! with `silhouettes`; `deadwood` (from both); `legend`; what they share: `light` (translucent layers) and `variety`.

pub mod area;
mod deadwood;
mod ground;
mod legend;
mod light;
mod plan;
mod profile;
mod silhouettes;
mod symbols;
mod variety;

use image::RgbImage;

use super::canvas::{Canvas, Rect};
use super::furniture::{
    self, CAPTION, FRAME_INK, INK, LABEL, NAME, PAPER, SUBTITLE, TITLE, UNIT, crs_name,
};
use super::layout::{HEADER_PX, MARGIN_PX};
use super::lettering::{Align, Lettering, Style};
use super::scale;
use crate::plants::Plants;
use crate::plants::deadwood::Deadwood;
use crate::raster::{Frame, Grid};
use crate::species::Biome;
use area::{Area, AreaError};
use deadwood::SeenDeadwood;
use ground::{GroundCover, Litters};
use legend::{DeadwoodLegend, Figures, LayerLegend};
use plan::{Seen, View};
use profile::{Site, Transect};

/// Side of the plan, and length of the profile.
const PLAN_PX: u32 = 1200;
/// Width of the legend, and the space left of it.
const LEGEND_PX: u32 = 380;
const GUTTER_PX: u32 = 58;
/// Room for scale bar and north arrow below the plan.
const SCALE_PX: u32 = 84;
/// Room for the profile's title.
const PROFILE_HEAD_PX: u32 = 66;
/// Space between two profiles.
const GAP_PX: u32 = 30;
/// What a profile of the undergrowth shows over the highest ground. chosen: where shrubs end.
const UNDERSTOREY_M: f32 = 6.0;
/// Room left of plan and profile for the axis.
const AXIS_PX: u32 = 20;

/// How symbols are to be read.
const REMARKS: [&str; 7] = [
    "Rosette: fern.  Mat of small leaves: herb.",
    "Disc of several domes: shrub.",
    "Small disc with a stem: sapling; spiky: conifer.",
    "Ring: crown of a canopy tree. Its dot is the stem,",
    "thick by its diameter at breast height.",
    "Shade: ground and plants under crowns.",
    "A–A′: the strip that the profile shows.",
];

/// How deadwood is to be read, where a forest has it.
const DEADWOOD_REMARKS: [&str; 3] = [
    "Crossed circle: snag, a dead tree that stands.",
    "Its rays are the branches that it still has.",
    "Brown bar: downed log, the paler the more decayed.",
];
const REMARK_PX: u32 = 22;

/// What a close-up is drawn from; all rasters on one frame.
#[derive(Clone, Copy, Debug)]
pub struct CloseUpInput<'a> {
    /// The ground.
    pub elevation_m: &'a Grid<f32>,
    /// Canopy and undergrowth of the scene.
    pub plants: &'a Plants,
    /// What the plants' species are.
    pub biome: &'a Biome,
    /// Height of the grass, where it was worked out.
    pub grass_height_m: Option<&'a Grid<f32>>,
    /// Share of the ground under litter, where it was worked out.
    pub litterfall: Option<&'a Grid<f32>>,
    /// Snags and downed logs, where the forest has a history.
    pub deadwood: Option<&'a Deadwood>,
}

/// One composed picture of an area: plan, legend, profile. The same picture for the same input on every machine.
///
/// # Errors
/// [`AreaError::Outside`] if the area's middle lies outside the scene.
///
/// # Panics
/// If the terrain has no cells, or a plant's species is none of the biome's.
pub fn close_up(input: &CloseUpInput<'_>, area: &Area, title: &str) -> Result<RgbImage, AreaError> {
    let CloseUpInput { elevation_m, plants, biome, deadwood, .. } = *input;
    let frame = elevation_m.frame();
    area.check_on(frame)?;
    let litters = Litters {
        grass_height_m: input.grass_height_m.map(|g| (g, biome.forest_floor.max_grass_height_m)),
        litterfall: input.litterfall,
    };
    let view = View::new(area, frame, PLAN_PX);
    let seen = Seen::of(plants, &view);
    let ground = GroundCover::of(elevation_m, &litters, &area.window(), PLAN_PX);
    let covers = [&seen.canopy, &seen.undergrowth]
        .map(|some| plan::cover_fraction(plants, some, &view, &ground));
    let dead = deadwood.map(|d| (d, SeenDeadwood::of(d, &view)));
    let site = Site { elevation_m, litters: &litters, plants, deadwood };
    let transect = Transect::new(&site, area, PLAN_PX);
    let understorey = transect.understorey(&site, area, PLAN_PX, UNDERSTOREY_M);

    // places
    let plan_rect =
        Rect { x: MARGIN_PX + AXIS_PX, y: MARGIN_PX + HEADER_PX, width: PLAN_PX, height: PLAN_PX };
    let legend_x = plan_rect.right() + GUTTER_PX;
    let profile_y = plan_rect.bottom() + SCALE_PX + PROFILE_HEAD_PX;
    let understorey_y = profile_y + transect.height_px() + PROFILE_HEAD_PX + GAP_PX;
    let width = legend_x + LEGEND_PX + MARGIN_PX;
    let bottom = match &understorey {
        Some(understorey) => understorey_y + understorey.height_px(),
        None => profile_y + transect.height_px(),
    };
    let remarks: Vec<&str> = match deadwood {
        Some(_) => REMARKS.into_iter().chain(DEADWOOD_REMARKS).collect(),
        None => REMARKS.to_vec(),
    };
    let remarks_bottom = profile_y + 30 + REMARK_PX * remarks.len() as u32; // a few lines
    let bottom = if deadwood.is_some() { bottom.max(remarks_bottom) } else { bottom };
    let height = bottom + MARGIN_PX;
    let mut pen =
        Pen { canvas: Canvas::new(width, height, PAPER), lettering: Lettering::default() };

    // heading, plan
    pen.heading(area, frame, &ground, title, plan_rect.x);
    plan::draw(plants, &seen, dead.as_ref(), biome, &view, &ground)
        .onto(&mut pen.canvas, [plan_rect.x, plan_rect.y]);
    pen.canvas.frame(plan_rect, FRAME_INK);
    pen.strip(plan_rect, transect.depth_m() * view.px_per_m());
    let below = plan_rect.bottom() + 44;
    let m_per_px = area.size_m() / f64::from(PLAN_PX);
    furniture::scale_bar(&mut pen.canvas, &pen.lettering, [plan_rect.x, below], m_per_px);
    furniture::north_arrow(&mut pen.canvas, &pen.lettering, [plan_rect.right() - 14, below - 28]);

    // legend
    let mut rect = Rect { x: legend_x, y: plan_rect.y, width: LEGEND_PX, height: PLAN_PX };
    let layers = [(&seen.undergrowth, "Undergrowth", false), (&seen.canopy, "Canopy", true)];
    for (some, name, is_canopy) in layers {
        let layer = LayerLegend::of(plants, some, biome, &view);
        rect.y = layer.draw(&mut pen.canvas, &pen.lettering, rect, name, biome, is_canopy);
    }
    let own = dead.as_ref().map(|(deadwood, seen)| (*deadwood, seen.own(deadwood, &view)));
    if let Some((deadwood, own)) = &own {
        let legend = DeadwoodLegend::of(deadwood, own);
        rect.y = legend.draw(&mut pen.canvas, &pen.lettering, rect);
    }
    let known = ground.elevation_m().mask();
    let land_m2 = known.valid_count() as f64 * m_per_px * m_per_px;
    let mut figures = Figures::of(plants, &seen, &view, land_m2, covers);
    figures.downed_m3_ha = own.as_ref().map(|(d, own)| own.downed_m3(d) * 1e4 / land_m2.max(1.0));
    figures.draw(&mut pen.canvas, &pen.lettering, rect);

    // profiles
    let crowding = covers[0] as f32; // a share
    let stand = Some((&transect, "Profile A–A′", profile_y));
    let low = understorey.as_ref().map(|low| (low, "Undergrowth A–A′", understorey_y));
    for (transect, name, y) in stand.into_iter().chain(low) {
        pen.profile_heading(transect, name, &site, [plan_rect.x, y - 42]);
        let place = [plan_rect.x, y];
        transect.draw(&mut pen.canvas, &pen.lettering, place, &site, biome, crowding);
    }
    pen.remarks([legend_x, profile_y], &remarks);
    Ok(pen.canvas.into_image())
}

/// Draws a sheet's parts.
struct Pen {
    canvas: Canvas,
    lettering: Lettering,
}

impl Pen {
    fn text(&mut self, x: u32, y: u32, align: Align, text: &str, style: Style) {
        self.lettering.draw(&mut self.canvas, x as f32, y as f32, align, text, style);
    }

    fn heading(&mut self, area: &Area, frame: &Frame, ground: &GroundCover, title: &str, x: u32) {
        let (middle, side) = (area.middle(), scale::length_label(area.size_m()));
        let right = self.canvas.image().width() - MARGIN_PX;
        let place = format!(
            "E {}, N {}",
            scale::trimmed(middle.east_m, 1),
            scale::trimmed(middle.north_m, 1)
        );
        let heading = format!("{title}   ·   {place}");
        let room = (right - x) as f32;
        let heading = self.lettering.shortened(&heading, TITLE, room);
        self.text(x, MARGIN_PX + 26, Align::Left, &heading, TITLE);
        let mut facts = format!("{side} × {side}   ·   {}", crs_name(&frame.crs));
        if let Some((low, high)) = ground.elevation_m().range() {
            let [low, high] = [low, high].map(|z| scale::fixed(f64::from(z), 1));
            facts += &format!("   ·   {low}–{high} m above sea level");
        }
        self.text(x, MARGIN_PX + 57, Align::Left, &facts, SUBTITLE);
        let signature = Style { size_px: 13.0, ..UNIT };
        self.text(right, MARGIN_PX + 57, Align::Right, NAME, signature);
    }

    /// The strip of the profile, dashed over the plan.
    fn strip(&mut self, plan: Rect, depth_px: f32) {
        let middle = plan.y as f32 + plan.height as f32 / 2.0;
        for y in [middle - depth_px / 2.0, middle + depth_px / 2.0] {
            for x in plan.x..plan.right() {
                // dark and pale in turn: seen on any ground
                let ink = if (x - plan.x) % 16 < 9 { INK } else { PAPER };
                self.canvas.blend(i64::from(x), y as i64, ink, 0.8);
            }
        }
        let style = Style { bold: true, size_px: 17.0, color: INK };
        let y = middle as u32 + 6;
        self.text(plan.x - 10, y, Align::Right, "A", style);
        self.text(plan.right() + 10, y, Align::Left, "A′", style);
    }

    fn profile_heading(
        &mut self,
        transect: &Transect,
        name: &str,
        site: &Site<'_>,
        [x, y]: [u32; 2],
    ) {
        self.text(x, y, Align::Left, name, CAPTION);
        let [trees, low] = transect.counts(site.plants);
        let depth = scale::trimmed(f64::from(transect.depth_m()), 1);
        let length = scale::trimmed(f64::from(transect.length_m()), 0);
        let more = if transect.is_longer() { ", beyond the square too" } else { "" };
        let mut facts = format!(
            "looking north   ·   {length} m long{more}, {depth} m deep   ·   true scale   ·   canopy trees: {trees}, undergrowth: {low}"
        );
        if site.deadwood.is_some() {
            let [snags, downed_logs] = transect.dead_counts();
            facts += &format!(", snags: {snags}, downed logs: {downed_logs}");
        }
        let after = x + self.lettering.width_px(name, CAPTION) as u32 + 12;
        self.text(after, y, Align::Left, &facts, UNIT);
    }

    fn remarks(&mut self, [x, y]: [u32; 2], remarks: &[&str]) {
        self.text(x, y + 16, Align::Left, "How to read it", CAPTION);
        for (line, remark) in (1_u32..).zip(remarks) {
            self.text(x, y + 18 + REMARK_PX * line, Align::Left, remark, LABEL);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::export::deadwood_layer::tests::{downed_logs, snags};
    use crate::plants::Layer;
    use crate::raster::Mask;

    /// 200 × 200 m that rise gently to the east.
    fn slope() -> Grid<f32> {
        Grid::from_fn(100, 100, 2.0, |c| 300.0 + 0.1 * c.col as f32)
    }

    fn sonoma() -> Biome {
        Biome::builtin("sonoma").unwrap()
    }

    /// Plants of a layer: key of the species, east, north, height and crown radius in metres.
    fn add(plants: &mut Plants, layer: Layer, some: &[(&str, f32, f32, f32, f32)]) {
        for &(key, east_m, north_m, height_m, radius_m) in some {
            plants.id.push(plants.id.len() as u64 + 1);
            plants.species.push(sonoma().species_index(key).unwrap() as u16);
            plants.layer.push(layer);
            plants.east_m.push(east_m);
            plants.north_m.push(north_m);
            plants.z_m.push(300.0);
            plants.height_m.push(height_m);
            plants.crown_radius_m.push(radius_m);
            plants.dbh_m.push(height_m / 60.0);
            plants.age_years.push(20.0);
            plants.vigor.push(0.8);
        }
    }

    fn draw(elevation_m: &Grid<f32>, plants: &Plants, area: &str) -> Result<RgbImage, AreaError> {
        draw_dead(elevation_m, plants, None, area)
    }

    fn draw_dead(
        elevation_m: &Grid<f32>,
        plants: &Plants,
        deadwood: Option<&Deadwood>,
        area: &str,
    ) -> Result<RgbImage, AreaError> {
        let biome = sonoma();
        let input = CloseUpInput {
            elevation_m,
            plants,
            biome: &biome,
            grass_height_m: None,
            litterfall: None,
            deadwood,
        };
        close_up(&input, &area.parse()?, "Wood")
    }

    /// Pixel of the plan at a share of its side from the west and the north.
    fn plan_pixel(picture: &RgbImage, west: f32, north: f32) -> [i32; 3] {
        let at = |from: u32, share: f32| from + (share * PLAN_PX as f32) as u32;
        let (x, y) = (at(MARGIN_PX + AXIS_PX, west), at(MARGIN_PX + HEADER_PX, north));
        picture.get_pixel(x, y).0.map(i32::from)
    }

    /// How far a colour leans to the pinks of toyon.
    fn pink([r, g, b]: [i32; 3]) -> i32 {
        r.min(b) - g
    }

    #[test]
    fn a_plant_is_drawn_at_its_place_in_its_colour() {
        let (terrain, mut plants) = (slope(), Plants::default());
        // a quarter of the square from its west, three quarters from its south
        add(&mut plants, Layer::Undergrowth, &[("toyon", 85.0, 115.0, 4.0, 2.5)]);
        let picture = draw(&terrain, &plants, "100,100,60").unwrap();
        assert!(pink(plan_pixel(&picture, 0.25, 0.25)) > 60);
        for (west, north) in [(0.75, 0.25), (0.25, 0.75), (0.75, 0.75), (0.25, 0.36)] {
            assert!(pink(plan_pixel(&picture, west, north)) < 10, "{west} {north}");
        }
        let bare = draw(&terrain, &Plants::default(), "100,100,60").unwrap();
        assert_eq!(plan_pixel(&bare, 0.75, 0.75), plan_pixel(&picture, 0.75, 0.75));
    }

    #[test]
    fn plants_outside_the_square_are_not_drawn() {
        let (terrain, mut plants) = (slope(), Plants::default());
        let outside = [("toyon", 40.0, 160.0, 4.0, 2.5), ("chamise", 133.0, 100.0, 2.0, 1.5)];
        add(&mut plants, Layer::Undergrowth, &outside);
        add(&mut plants, Layer::Canopy, &[("redwood", 100.0, 10.0, 30.0, 4.0)]);
        let with = draw(&terrain, &plants, "100,100,60").unwrap();
        assert!(with == draw(&terrain, &Plants::default(), "100,100,60").unwrap());
    }

    #[test]
    fn undergrowth_is_seen_through_crowns_whose_shade_dims_it() {
        let (terrain, mut low) = (slope(), Plants::default());
        add(&mut low, Layer::Undergrowth, &[("toyon", 100.0, 112.0, 3.0, 2.5)]);
        let mut both = low.clone();
        add(&mut both, Layer::Canopy, &[("coast-live-oak", 100.0, 115.0, 18.0, 6.0)]);
        let open = plan_pixel(&draw(&terrain, &low, "100,100,60").unwrap(), 0.5, 0.29);
        let shaded = plan_pixel(&draw(&terrain, &both, "100,100,60").unwrap(), 0.5, 0.29);
        assert!(pink(shaded) > 40, "{shaded:?}");
        assert!(shaded.iter().sum::<i32>() < open.iter().sum::<i32>() - 30, "{shaded:?} {open:?}");
    }

    #[test]
    fn the_picture_is_the_same_for_any_number_of_threads_and_order_of_plants() {
        let (terrain, mut plants) = (slope(), Plants::default());
        let low: Vec<_> = (0..400)
            .map(|i| {
                let key = ["western-swordfern", "redwood-sorrel", "toyon", "redwood"][i % 4];
                let (east_m, north_m) =
                    (70.0 + 3.0 * (i % 20) as f32, 70.0 + 3.0 * (i / 20) as f32);
                (key, east_m, north_m, 0.4 + 0.1 * (i % 7) as f32, 0.8)
            })
            .collect();
        add(&mut plants, Layer::Undergrowth, &low);
        add(&mut plants, Layer::Canopy, &[("redwood", 95.0, 101.0, 30.0, 4.0)]);
        let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        let draw = |plants: &Plants| draw(&terrain, plants, "100,100,60").unwrap();
        let one = pool(1).install(|| draw(&plants));
        assert!(one == pool(3).install(|| draw(&plants)));
        let mut reversed = plants.clone();
        reversed.id.reverse();
        reversed.species.reverse();
        reversed.layer.reverse();
        let Plants { east_m, north_m, z_m, height_m, crown_radius_m, dbh_m, .. } = &mut reversed;
        for numbers in [east_m, north_m, z_m, height_m, crown_radius_m, dbh_m] {
            numbers.reverse();
        }
        assert!(one == draw(&reversed));
    }

    #[test]
    fn close_ups_without_deadwood_are_what_they_were_before_it_could_be_drawn() {
        let (terrain, mut plants) = (slope(), Plants::default());
        let low = [("toyon", 93.0, 107.0, 3.0, 2.0), ("western-swordfern", 104.0, 99.0, 0.8, 0.7)];
        add(&mut plants, Layer::Undergrowth, &low);
        add(&mut plants, Layer::Canopy, &[("redwood", 95.0, 101.0, 40.0, 4.0)]);
        let picture = draw(&terrain, &plants, "100,100,60").unwrap();
        let hash = blake3::hash(picture.as_raw()).to_hex();
        assert_eq!(
            (picture.width(), picture.height(), &hash[..16]),
            (1754, 2410, "5343f9509fc588f0")
        );
    }

    #[test]
    fn deadwood_lies_at_its_place_and_stands_in_the_profile() {
        let (terrain, plants) = (slope(), Plants::default());
        let east = std::f32::consts::FRAC_PI_2;
        // across the middle of the western half; a snag in the strip of the eastern half
        let deadwood = Deadwood {
            downed_logs: downed_logs(&[(75.0, 115.0, 20.0, 1.0, east, 1)]),
            snags: snags(&[(115.0, 100.0, 20.0, 30.0, 0.8, 0.6, 3)]),
        };
        let draw = |deadwood| draw_dead(&terrain, &plants, Some(deadwood), "100,100,60").unwrap();
        let nothing = Deadwood::default();
        let (with, none) = (draw(&deadwood), draw(&nothing));
        // 75–95 m of 70–130 m east, 115 m of 70–130 m north
        let brown = |p: &RgbImage, west| {
            let [r, g, b] = plan_pixel(p, west, 0.25);
            r > g + 10 && g > b && r < 150
        };
        assert!(brown(&with, 0.15) && brown(&with, 0.38));
        assert_eq!(plan_pixel(&with, 0.5, 0.25), plan_pixel(&none, 0.5, 0.25));
        assert!(plan_pixel(&with, 0.75, 0.5) != plan_pixel(&none, 0.75, 0.5));
        assert!(with.height() > none.height(), "the profile has room for the snag");
        // what lies and stands elsewhere is not drawn
        let mut far = deadwood.clone();
        far.downed_logs.east_m[0] = 30.0;
        far.snags.north_m[0] = 180.0;
        assert!(draw(&far) == none);
    }

    #[test]
    fn areas_outside_the_scene_are_errors_and_those_over_its_edge_are_drawn() {
        let terrain = slope();
        let draw = |area| draw(&terrain, &Plants::default(), area);
        for area in ["201,100,60", "-1,100,60", "100,300,60"] {
            assert!(matches!(draw(area), Err(AreaError::Outside { .. })), "{area}");
        }
        let edge = draw("0,100,60").unwrap();
        let void = [furniture::VOID, furniture::VOID_HATCH].map(|c| c.map(i32::from));
        assert!(void.contains(&plan_pixel(&edge, 0.2, 0.2)));
        assert!(!void.contains(&plan_pixel(&edge, 0.8, 0.2)));
    }

    #[test]
    fn a_scene_without_known_ground_is_drawn() {
        let slope = slope();
        let nowhere = Grid::new(
            Arc::clone(slope.frame()),
            Arc::new(Mask::new(vec![false; 10_000])),
            slope.values().to_vec(),
        );
        let mut plants = Plants::default();
        add(&mut plants, Layer::Canopy, &[("redwood", 95.0, 101.0, 40.0, 4.0)]);
        for area in ["100,100,10", "100,100,200"] {
            let picture = draw(&nowhere, &plants, area).unwrap();
            assert!(picture.width() > PLAN_PX && picture.height() > PLAN_PX, "{area}");
        }
    }
}
