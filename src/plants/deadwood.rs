//! Deadwood of a scene: snags and downed logs, one array a measure, and what happened to plants.

use crate::math;

/// What killed a plant, or brought wood to the ground.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize,
)]
pub enum Cause {
    /// Old age, and whatever else has nothing to do with stress.
    Age,
    /// Too little light or water beside its neighbours, or a place that does not suit it.
    Competition,
    /// A season with too little rain.
    Drought,
    /// Disease.
    Disease,
    /// Fire.
    Fire,
    /// Wind.
    Storm,
    /// Rot: dead wood that broke or fell.
    Decay,
    /// Shade: branches that a living tree gave up.
    SelfPruning,
}

impl Cause {
    /// Every cause, in the order of their numbers.
    pub const ALL: [Self; 8] = [
        Self::Age,
        Self::Competition,
        Self::Drought,
        Self::Disease,
        Self::Fire,
        Self::Storm,
        Self::Decay,
        Self::SelfPruning,
    ];

    /// The cause's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Age => "age",
            Self::Competition => "competition",
            Self::Drought => "drought",
            Self::Disease => "disease",
            Self::Fire => "fire",
            Self::Storm => "storm",
            Self::Decay => "decay",
            Self::SelfPruning => "self-pruning",
        }
    }

    /// The cause of a name in a file.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|cause| cause.name() == name)
    }
}

/// What part of a tree a downed log is.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize,
)]
pub enum DownedLogKind {
    /// A stem that fell from its stump.
    Trunk,
    /// The upper part of a stem that snapped.
    Top,
    /// A primary branch.
    Branch,
    /// A stem with its root plate.
    Uprooted,
}

impl DownedLogKind {
    /// Every kind, in the order of their numbers.
    pub const ALL: [Self; 4] = [Self::Trunk, Self::Top, Self::Branch, Self::Uprooted];

    /// The kind's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Trunk => "trunk",
            Self::Top => "top",
            Self::Branch => "branch",
            Self::Uprooted => "uprooted",
        }
    }

    /// The kind of a name in a file.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// Snags: dead trees that still stand, stumps included. Struct of arrays, one snag an index.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snags {
    /// The id of the tree when it lived.
    pub id: Vec<u64>,
    /// Index into the biome's species.
    pub species: Vec<u16>,
    /// Metres east of the scene's south-west corner.
    pub east_m: Vec<f32>,
    /// Metres north of the scene's south-west corner.
    pub north_m: Vec<f32>,
    /// Elevation of the ground.
    pub z_m: Vec<f32>,
    /// Height that still stands.
    pub height_m: Vec<f32>,
    /// Height at death.
    pub height_at_death_m: Vec<f32>,
    /// Diameter at breast height, at death.
    pub dbh_m: Vec<f32>,
    /// Years since death.
    pub years_dead: Vec<f32>,
    /// Decay class, 1–5 (Peytavie 2024, Table 2).
    pub decay_class: Vec<u8>,
    /// Density of its wood over that at death, 0..=1.
    pub density_fraction: Vec<f32>,
    /// Share of its primary branches that it still has, 0..=1.
    pub branch_fraction: Vec<f32>,
    /// What killed it.
    pub cause: Vec<Cause>,
}

/// Downed logs: wood on the ground. Struct of arrays, one downed log an index.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DownedLogs {
    /// Stable and unique among the downed logs of a scene.
    pub id: Vec<u64>,
    /// The id of the plant that it comes from.
    pub parent_id: Vec<u64>,
    /// Index into the biome's species.
    pub species: Vec<u16>,
    /// What part of the tree it is.
    pub kind: Vec<DownedLogKind>,
    /// Thick end, metres east of the scene's south-west corner.
    pub east_m: Vec<f32>,
    /// Thick end, metres north of the scene's south-west corner.
    pub north_m: Vec<f32>,
    /// Elevation of the ground at its middle.
    pub z_m: Vec<f32>,
    /// Length along the map; ends are `azimuth_rad` apart.
    pub length_m: Vec<f32>,
    /// Diameter of the thick end, when it came down.
    pub diameter_base_m: Vec<f32>,
    /// Diameter of the thin end, when it came down.
    pub diameter_tip_m: Vec<f32>,
    /// Direction from the thick end to the thin one, clockwise from north.
    pub azimuth_rad: Vec<f32>,
    /// Years since it came down.
    pub years_down: Vec<f32>,
    /// Decay class, 1–5 (Peytavie 2024, Table 2).
    pub decay_class: Vec<u8>,
    /// Density of its wood over that at death, 0..=1.
    pub density_fraction: Vec<f32>,
    /// What brought it down.
    pub cause: Vec<Cause>,
}

/// What is dead in a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deadwood {
    /// What still stands.
    pub snags: Snags,
    /// What lies on the ground.
    pub downed_logs: DownedLogs,
}

impl Deadwood {
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.snags.is_empty() && self.downed_logs.is_empty()
    }
}

impl Snags {
    /// Number of snags.
    pub fn len(&self) -> usize {
        self.id.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.id.is_empty()
    }
}

impl DownedLogs {
    /// Number of downed logs.
    pub fn len(&self) -> usize {
        self.id.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.id.is_empty()
    }

    /// Thin end of a downed log: metres east and north of the scene's south-west corner.
    pub fn thin_end_m(&self, i: usize) -> [f32; 2] {
        let (length_m, azimuth_rad) = (self.length_m[i], self.azimuth_rad[i]);
        let (east_m, north_m) = (self.east_m[i], self.north_m[i]);
        [east_m + length_m * math::sin(azimuth_rad), north_m + length_m * math::cos(azimuth_rad)]
    }

    /// Volume of a downed log when it came down, m³: a straight taper between its ends, as long as it is on the map.
    pub fn volume_m3(&self, i: usize) -> f64 {
        frustum_m3(self.length_m[i], self.diameter_base_m[i], self.diameter_tip_m[i])
    }
}

/// Volume in m³ of a truncated cone by its length and the diameters of its ends, m.
pub fn frustum_m3(length_m: f32, base_m: f32, tip_m: f32) -> f64 {
    let [length_m, base_m, tip_m] = [length_m, base_m, tip_m].map(f64::from);
    std::f64::consts::PI / 12.0 * length_m * (base_m * base_m + base_m * tip_m + tip_m * tip_m)
}

/// Something that happened to a plant.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize,
)]
pub enum LifeEventKind {
    /// It was there when the simulation began.
    Present,
    /// It sprouted.
    Sprouted,
    /// It caught a disease; severity is what that takes of its reserves each month.
    Infected,
    /// It recovered from a disease.
    Recovered,
    /// Fire reached it; severity is the share of it that burnt.
    Burnt,
    /// Wind broke branches; severity is their share.
    BranchesBroken,
    /// Wind broke its stem; severity is the share of its height that fell.
    Snapped,
    /// Wind threw it.
    Uprooted,
    /// It died; severity is its chance of death in that year.
    Died,
    /// Its dead stem broke; severity is the share of its height that fell.
    SnagSnapped,
    /// Its dead stem fell from the stump.
    SnagFell,
    /// Too little rain drew on its reserves; severity is the share of a full pool that was gone at the worst.
    Parched,
}

impl LifeEventKind {
    /// Every kind, in the order of their numbers.
    pub const ALL: [Self; 12] = [
        Self::Present,
        Self::Sprouted,
        Self::Infected,
        Self::Recovered,
        Self::Burnt,
        Self::BranchesBroken,
        Self::Snapped,
        Self::Uprooted,
        Self::Died,
        Self::SnagSnapped,
        Self::SnagFell,
        Self::Parched,
    ];

    /// The kind's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Present => "present",
            Self::Sprouted => "sprouted",
            Self::Infected => "infected",
            Self::Recovered => "recovered",
            Self::Burnt => "burnt",
            Self::BranchesBroken => "branches-broken",
            Self::Snapped => "snapped",
            Self::Uprooted => "uprooted",
            Self::Died => "died",
            Self::SnagSnapped => "snag-snapped",
            Self::SnagFell => "snag-fell",
            Self::Parched => "parched",
        }
    }
}

/// A line of the life histories.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LifeEvent {
    /// The plant's id.
    pub plant_id: u64,
    /// Year of the simulation, from 1; 0 is the state that it began with.
    pub year: u16,
    /// Month, 1–12.
    pub month: u8,
    /// What happened.
    pub kind: LifeEventKind,
    /// How much of it, see [`LifeEventKind`]; 0 where nothing is said.
    pub severity: f32,
    /// What caused a death; [`Cause::Age`] where there was none.
    pub cause: Cause,
}

/// A species' year.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TimelineRow {
    /// Year of the simulation, from 1; 0 is the state that it began with.
    pub year: u16,
    /// Index into the biome's species.
    pub species: u16,
    /// Live plants at the end of the year.
    pub live: u32,
    /// Of them, those with a stem of 7.5 cm and more.
    pub live_trees: u32,
    /// Snags.
    pub snags: u32,
    /// Downed logs.
    pub downed_logs: u32,
    /// Seedlings of the year.
    pub sprouted: u32,
    /// Basal area of live stems of 7.5 cm and more, m²/ha.
    pub live_m2_ha: f32,
    /// The same of snags that are more than stumps.
    pub snag_m2_ha: f32,
    /// The same of downed stems: the cross section of their thick ends; branches are left out.
    pub downed_log_m2_ha: f32,
    /// Deaths of the year by cause, in the order of [`Cause::ALL`].
    pub deaths: [u32; 8],
    /// Of them, those with a stem of 7.5 cm and more.
    pub tree_deaths: [u32; 8],
}

/// The year of a plant whose growth is recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct GrowthRecord {
    /// The plant's id.
    pub plant_id: u64,
    /// Year of the simulation, from 1; 0 is the state that it began with.
    pub year: u16,
    /// Height above ground, at the end of the year.
    pub height_m: f32,
    /// Crown radius.
    pub crown_radius_m: f32,
    /// Stem diameter at breast height.
    pub dbh_m: f32,
    /// Suitability of the site, −0.2..=1.
    pub vigor: f32,
    /// Its reserves, in months of the best vigor: 1 to 2.5 when full, by its height; below 0 overdrawn.
    pub carbon_pool: f32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_kept_and_numbers_are_places_in_all() {
        for (place, cause) in Cause::ALL.into_iter().enumerate() {
            assert_eq!((Cause::from_name(cause.name()), cause as usize), (Some(cause), place));
        }
        for (place, kind) in DownedLogKind::ALL.into_iter().enumerate() {
            assert_eq!((DownedLogKind::from_name(kind.name()), kind as usize), (Some(kind), place));
        }
        for (place, kind) in LifeEventKind::ALL.into_iter().enumerate() {
            assert_eq!(kind as usize, place);
        }
        assert_eq!((Cause::from_name("Age"), DownedLogKind::from_name("log")), (None, None));
    }

    #[test]
    fn downed_logs_lie_along_their_azimuth_and_have_the_volume_of_a_frustum() {
        let mut downed_logs = DownedLogs::default();
        for (azimuth_rad, tip_m) in [(std::f32::consts::FRAC_PI_2, 0.4), (0.0, 0.0)] {
            downed_logs.east_m.push(10.0);
            downed_logs.north_m.push(20.0);
            downed_logs.length_m.push(6.0);
            downed_logs.azimuth_rad.push(azimuth_rad);
            downed_logs.diameter_base_m.push(0.4);
            downed_logs.diameter_tip_m.push(tip_m);
        }
        let ends = [downed_logs.thin_end_m(0), downed_logs.thin_end_m(1)];
        for (end, expected) in ends.iter().zip([[16.0, 20.0], [10.0, 26.0]]) {
            assert!(end.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{end:?}");
        }
        // a cylinder, and a cone of a third of it
        let cylinder_m3 = std::f64::consts::PI * 0.04 * 6.0;
        assert!((downed_logs.volume_m3(0) / cylinder_m3 - 1.0).abs() < 1e-6);
        assert!((downed_logs.volume_m3(1) / cylinder_m3 - 1.0 / 3.0).abs() < 1e-6);
    }
}
