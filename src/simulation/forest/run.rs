//! A forest and its year.

use super::deaths::Toll;
use super::ground::ForestGround;
use super::outbreaks::Outbreak;
use super::seeds::SeedMap;
use super::tally::{self, Tally, YearTally};
use crate::plants::deadwood::{LifeEvent, TimelineRow};
use crate::plants::{Layer, Plants};
use crate::raster::{Frame, Grid, MONTHS, MonthlyGrid};
use crate::simulation::community::{Circumstances, Losses, Season};
use crate::simulation::deadwood::falling::StandingTrunks;
use crate::simulation::deadwood::stock::Surroundings;
use crate::simulation::deadwood::{DecayParameters, Stock};
use crate::simulation::disturbance::{Disturbance, Event};
use crate::simulation::traits::Traits;
use crate::simulation::{Community, Parameters, Plot};
use crate::species::Biome;

/// Seedlings' ids begin at multiples of this, above all ids that a simulation begins with: year and cell lie below.
const SEEDLING_ID_STEP: u64 = 1 << 48;
/// Shade of plants whose surroundings are not known yet. chosen: half.
const UNKNOWN_SHADE: f32 = 0.5;
/// Least stem that others fall beside. chosen: thinner ones give way.
const LEAST_STANDING_DBH_M: f32 = 0.1;

/// Where a forest stands.
pub struct Site<'a> {
    /// Its ground, from [`Plot::open`].
    pub plot: Plot,
    /// Elevation of the scene.
    pub elevation_m: &'a Grid<f32>,
    /// Its species.
    pub biome: &'a Biome,
}

/// A forest: what lives, what is dead, and what happened.
///
/// ```
/// use wildwood::simulation::deadwood::DecayParameters;
/// use wildwood::simulation::forest::{Forest, Site};
/// use wildwood::simulation::{Parameters, Plot};
/// use wildwood::terrain::generate::{GenerateParams, generate};
/// use wildwood::{abiotics, progress::Reporter, species::Biome};
///
/// let (reporter, biome) = (Reporter::silent(), Biome::builtin("pyrenees")?);
/// let heights = GenerateParams { relief_m: 10.0, lowest_m: 1250.0, ..Default::default() };
/// let ground = GenerateParams { rows: 32, cols: 32, ..heights };
/// let terrain = generate(&ground, &reporter)?;
/// let maps = abiotics::run(&terrain, &biome.climate, &Default::default(), &reporter)?;
///
/// // bare ground, but for rivers, on which seeds come in from around
/// let parameters = Parameters::forest(&biome);
/// let plot = Plot::open(&maps, maps.river.values(), &biome, &parameters);
/// let site = Site { plot, elevation_m: &terrain.elevation_m, biome: &biome };
/// let mut forest = Forest::new(site, parameters, DecayParameters::peytavie2024(), 1);
/// (0..12).for_each(|_| forest.live_a_year(&[]));
///
/// assert_eq!(forest.year(), 12);
/// assert!(forest.community().len() > 100);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
pub struct Forest {
    pub(super) biome: Biome,
    pub(super) community: Community,
    pub(super) stock: Stock,
    pub(super) ground: ForestGround,
    pub(super) decay: DecayParameters,
    pub(super) seed: u64,
    pub(super) outbreaks: Vec<Outbreak>,
    /// Number of diseases that broke out so far.
    pub(super) outbreak_count: u32,
    pub(super) history: Vec<LifeEvent>,
    pub(super) timeline: Vec<TimelineRow>,
    pub(super) tally: Tally,
    /// Area that each fire burnt, with its year.
    pub(super) burnt_m2: Vec<(u16, f32)>,
    /// Whether a decaying downed log lies on each simulation cell.
    downed_log_cells: Vec<bool>,
    /// Share of the usual rain by month of the year that comes.
    pub(super) rain_fraction: [f32; MONTHS],
}

impl Forest {
    /// Bare ground, in year 0.
    pub fn new(site: Site, parameters: Parameters, decay: DecayParameters, seed: u64) -> Self {
        let Site { plot, elevation_m, biome } = site;
        let elevation_m = plot.joined_mean(elevation_m);
        let ground = ForestGround::new(&plot, elevation_m, &decay);
        let mut community = Community::new(plot, biome, parameters, seed);
        community.set_first_seedling_id(SEEDLING_ID_STEP);
        let mut forest = Self {
            biome: biome.clone(),
            community,
            stock: Stock::default(),
            ground,
            decay,
            seed,
            outbreaks: Vec::new(),
            outbreak_count: 0,
            history: Vec::new(),
            timeline: Vec::new(),
            tally: Tally::default(),
            burnt_m2: Vec::new(),
            downed_log_cells: Vec::new(),
            rain_fraction: [1.0; MONTHS],
        };
        forest.take_stock(&YearTally::new(biome.species.len()));
        forest
    }

    /// The same with plants of a scene, as large as they are, their ages from their heights and their reserves full. Trees of its
    /// canopy are acclimated to where they stand.
    ///
    /// # Panics
    /// If a species is none of the biome's.
    pub fn with_plants(mut self, plants: &Plants, frame: &Frame) -> Self {
        let north_m = frame.rows as f32 * frame.cell_m();
        let most_id = plants.id.iter().copied().max().unwrap_or(0);
        self.community.set_first_seedling_id((most_id / SEEDLING_ID_STEP + 1) * SEEDLING_ID_STEP);
        for plant in 0..plants.len() {
            let species = plants.species[plant];
            let height_m = plants.height_m[plant];
            let age_years = self.biome.species[usize::from(species)]
                .age_at_height_years(height_m, UNKNOWN_SHADE);
            let at = [plants.east_m[plant], north_m - plants.north_m[plant]];
            let community = &mut self.community;
            community.plant(plants.id[plant], species, at, age_years);
            let last = community.len() - 1;
            community.height_m[last] = height_m;
            community.crown_radius_m[last] = plants.crown_radius_m[plant];
            community.dbh_m[last] = plants.dbh_m[plant];
            community.carbon_pool[last] = community.pool_capacity(last);
            community.vigor[last] = plants.vigor[plant];
        }
        let standing: Vec<bool> =
            plants.layer.iter().map(|layer| *layer == Layer::Canopy).collect();
        self.community.acclimate(&standing);
        self.tally.present = plants.len() as u64;
        self.timeline.clear();
        self.take_stock(&YearTally::new(self.biome.species.len()));
        self
    }

    /// Lives through a year with these events, which are all of it but droughts: soil water is what [`Forest::set_moisture`] gave.
    ///
    /// # Panics
    /// If an event is of another year.
    pub fn live_a_year(&mut self, events: &[Event]) {
        self.community.begin_year();
        self.lay_seeds();
        let year = self.community.year();
        assert!(events.iter().all(|event| event.year == year), "an event of another year");
        let (plants, first_of_year) = (self.community.len(), self.history.len());
        let mut toll = Toll::new(plants);

        // diseases first: what they take of reserves depends on no month's growth
        for event in events {
            if let Disturbance::Disease(disease) = &event.what {
                self.outbreaks.push(Outbreak::new(*disease, event.month, self.outbreak_count));
                self.outbreak_count += 1;
            }
        }
        let mut losses = self.spread_diseases(&mut toll);
        let mut figures = YearTally::new(self.biome.species.len());

        // months, with what strikes in them
        let mut season = Season::default();
        season.lowest_pool.resize(plants, f32::INFINITY);
        let mut month = 0;
        for event in events {
            let strikes = usize::from(event.month) - 1;
            if !matches!(event.what, Disturbance::Wildfire(_) | Disturbance::WindStorm(_)) {
                continue;
            }
            self.grow(month, strikes, &losses, &mut season);
            month = month.max(strikes);
            match &event.what {
                Disturbance::Wildfire(fire) => {
                    self.burn(fire, event.month, &mut season, &mut toll);
                }
                Disturbance::WindStorm(storm) => {
                    let felled = self.blow(storm, event.month, &mut season, &mut figures);
                    toll.forget(&felled, event.month, &mut season, &mut losses);
                }
                _ => {}
            }
        }
        self.grow(month, MONTHS, &losses, &mut season);

        // the year's end
        self.record_drought(&season);
        let trunks = self.standing_trunks();
        let Self { community, stock, ground, history, .. } = self;
        let around = Surroundings {
            parameters: &self.decay,
            ground,
            species: &self.biome.species,
            trunks: &trunks,
        };
        let (dead, ()) = rayon::join(
            || community.die(&season.lowest_pool),
            || stock.decay(&around, self.seed, year, history),
        );
        self.bury(&dead, &toll, &mut figures);
        self.order_history(first_of_year, toll.felled);
        self.prune();
        let before = self.community.len();
        self.tally.sprouted += self.community.sprout(season) as u64;
        for species in &self.community.species[before..] {
            figures.sprouted[usize::from(*species)] += 1;
        }
        self.take_stock(&figures);
    }

    fn grow(&mut self, from: usize, to: usize, losses: &Losses, season: &mut Season) {
        if from < to {
            let around =
                Circumstances { downed_logs: &self.downed_log_cells, losses: Some(losses) };
            self.community.grow(from..to, &around, season);
        }
    }

    /// Lays the year's seeds, where those of sub-biomes are to be told apart.
    fn lay_seeds(&mut self) {
        if self.biome.sub_biomes.len() > 1 {
            let seeds = SeedMap::of(&self.community, &self.biome);
            self.community.plot_mut().set_seeds(|row, col| seeds.at(row, col));
        }
    }

    /// Counts the forest, and tells seeds where decaying downed logs lie.
    fn take_stock(&mut self, figures: &YearTally) {
        let (community, stock, biome) = (&self.community, &self.stock, &self.biome);
        let marks = &mut self.downed_log_cells;
        let (rows, ()) = rayon::join(
            || tally::rows(community, stock, biome, figures),
            || mark_downed_logs(community.plot(), stock, marks),
        );
        self.timeline.extend(rows);
    }

    /// Tells seeds where decaying downed logs lie.
    pub(super) fn mark_downed_logs(&mut self) {
        mark_downed_logs(self.community.plot(), &self.stock, &mut self.downed_log_cells);
    }

    /// Live trees and snags that others fall beside.
    pub(super) fn standing_trunks(&self) -> StandingTrunks {
        let community = &self.community;
        let live = (0..community.len())
            .filter(|plant| community.dbh_m[*plant] >= LEAST_STANDING_DBH_M)
            .map(|plant| {
                let at = [community.east_m[plant], community.south_m[plant]];
                (community.id[plant], at, community.dbh_m[plant])
            });
        let snags = self.stock.snags.iter().filter(|snag| snag.dbh_m >= LEAST_STANDING_DBH_M);
        let dead = snags.map(|snag| (snag.id, [snag.east_m, snag.south_m], snag.dbh_m));
        StandingTrunks::new(live.chain(dead))
    }

    /// Takes other soil water for the years that come, as monthly maps of the scene have it, and the share of the usual rain
    /// that it comes from.
    pub fn set_moisture(
        &mut self,
        frame: &Frame,
        moisture_mm: &MonthlyGrid,
        rain_fraction: [f32; MONTHS],
    ) {
        self.community.plot_mut().set_moisture(frame, moisture_mm);
        self.ground.set_moisture(self.community.plot(), &self.decay);
        self.rain_fraction = rain_fraction;
    }

    /// Memory that simulation cells take: the plot, and what lies and stands on it cell by cell.
    pub fn cell_bytes(&self) -> usize {
        self.community.plot().bytes() + self.downed_log_cells.len() + self.ground.bytes()
    }

    /// Share of the usual rain by month that its soil water comes from.
    pub fn rain_fraction(&self) -> [f32; MONTHS] {
        self.rain_fraction
    }

    /// Years simulated.
    pub fn year(&self) -> u16 {
        self.community.year()
    }

    /// What lives.
    pub fn community(&self) -> &Community {
        &self.community
    }

    /// What is dead.
    pub fn stock(&self) -> &Stock {
        &self.stock
    }

    /// What happened to plants, in the order of time. Plants without a stem are left out.
    pub fn history(&self) -> &[LifeEvent] {
        &self.history
    }

    /// Figures of each year and species, from year 0.
    pub fn timeline(&self) -> &[TimelineRow] {
        &self.timeline
    }

    /// Area in m² that each fire burnt, with its year, in the order of time.
    pub fn burnt_m2(&self) -> &[(u16, f32)] {
        &self.burnt_m2
    }

    /// Plants that came and went.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    pub(super) fn traits(&self, species: u16) -> &Traits {
        self.community.traits(species)
    }
}

/// Marks the cells of a plot that decaying downed logs lie on.
fn mark_downed_logs(plot: &Plot, stock: &Stock, marks: &mut Vec<bool>) {
    let (rows, cols, cell_m) = (plot.rows, plot.cols, plot.cell_m);
    marks.clear();
    marks.resize(rows * cols, false);
    // bark is off and wood soft from class 3 on
    for downed_log in stock.downed_logs.iter().filter(|lying| lying.decay_class() >= 3) {
        downed_log.cells([rows, cols], cell_m, |row, col| marks[row * cols + col] = true);
    }
}
