//! Diseases in a forest: who is ill, month by month, and what that takes of reserves.

use super::deaths::Toll;
use super::run::Forest;
use super::tally::RECORDED_HEIGHT_M;
use crate::plants::deadwood::{Cause, LifeEvent, LifeEventKind};
use crate::simulation::community::Losses;
use crate::simulation::disturbance::disease::{self, Disease, Health, Hosts};

/// A disease that broke out.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Outbreak {
    disease: Disease,
    /// Month of its first year in which it begins; 0 once it has begun.
    begins_in_month: u8,
    /// Its number among all diseases of a simulation.
    number: u32,
    /// Plants that are not susceptible, by id.
    health: Vec<(u64, Health)>,
}

impl Outbreak {
    pub fn new(disease: Disease, begins_in_month: u8, number: u32) -> Self {
        Self { disease, begins_in_month, number, health: Vec::new() }
    }
}

/// Plants that a disease can befall.
struct HostPlants {
    /// Index in the community.
    plant: Vec<usize>,
    id: Vec<u64>,
    east_m: Vec<f32>,
    south_m: Vec<f32>,
    crown_radius_m: Vec<f32>,
}

impl Forest {
    /// A year of all diseases: what they take of plants' reserves.
    ///
    /// # Reference
    /// Peytavie et al. 2024, section 5.3.3.
    pub(super) fn spread_diseases(&mut self, toll: &mut Toll) -> Losses {
        let mut losses = Losses::default();
        let mut outbreaks = std::mem::take(&mut self.outbreaks);
        for outbreak in &mut outbreaks {
            self.spread(outbreak, toll, &mut losses);
        }
        // without anyone ill it cannot come back
        outbreaks.retain(|outbreak| outbreak.health.iter().any(|(_, health)| health.is_infected()));
        self.outbreaks = outbreaks;
        losses
    }

    fn spread(&mut self, outbreak: &mut Outbreak, toll: &mut Toll, losses: &mut Losses) {
        let disease = outbreak.disease;
        let host_plants = self.hosts(disease.species);
        let hosts = Hosts {
            id: &host_plants.id,
            east_m: &host_plants.east_m,
            south_m: &host_plants.south_m,
            crown_radius_m: &host_plants.crown_radius_m,
        };
        let mut health = vec![Health::default(); host_plants.id.len()];
        for (id, state) in host_plants.id.iter().zip(&mut health) {
            if let Ok(found) = outbreak.health.binary_search_by_key(id, |(id, _)| *id) {
                *state = outbreak.health[found].1;
            }
        }
        let plot = self.community.plot();
        let size_m = [plot.cols as f32 * plot.cell_m, plot.rows as f32 * plot.cell_m];
        let (year, plants) = (self.community.year(), self.community.len());
        let mut record = |host: u32, month: u8, kind: LifeEventKind| {
            let plant = host_plants.plant[host as usize];
            if self.community.height_m[plant] >= RECORDED_HEIGHT_M {
                self.history.push(LifeEvent {
                    plant_id: host_plants.id[host as usize],
                    year,
                    month,
                    kind,
                    severity: disease.severity_per_month,
                    cause: Cause::Disease,
                });
            }
        };
        let first_month = outbreak.begins_in_month.max(1);
        for month in first_month..=12 {
            if month == outbreak.begins_in_month {
                let first = disease::outbreak(
                    &disease,
                    &hosts,
                    size_m,
                    &mut health,
                    self.seed,
                    year,
                    month,
                    outbreak.number,
                );
                first.into_iter().for_each(|host| record(host, month, LifeEventKind::Infected));
            } else {
                let lived = disease::live_a_month(
                    &disease,
                    &hosts,
                    &mut health,
                    self.seed,
                    year,
                    month,
                    outbreak.number,
                );
                let infected = lived.infected.into_iter();
                infected.for_each(|host| record(host, month, LifeEventKind::Infected));
                let recovered = lived.recovered.into_iter();
                recovered.for_each(|host| record(host, month, LifeEventKind::Recovered));
            }
            for (state, plant) in health.iter().zip(&host_plants.plant) {
                if state.is_infected() {
                    toll.is_ill[*plant] = true;
                    let month_index = usize::from(month) - 1;
                    losses.add(plants, *plant, month_index, disease.severity_per_month);
                }
            }
        }
        outbreak.begins_in_month = 0;
        outbreak.health = (host_plants.id.iter().copied().zip(health))
            .filter(|(_, state)| *state != Health::default())
            .collect();
        outbreak.health.sort_unstable_by_key(|(id, _)| *id);
    }

    fn hosts(&self, species: u16) -> HostPlants {
        let community = &self.community;
        let plant: Vec<usize> =
            (0..community.len()).filter(|plant| community.species[*plant] == species).collect();
        let of = |values: &[f32]| plant.iter().map(|plant| values[*plant]).collect();
        HostPlants {
            id: plant.iter().map(|plant| community.id[*plant]).collect(),
            east_m: of(&community.east_m),
            south_m: of(&community.south_m),
            crown_radius_m: of(&community.crown_radius_m),
            plant,
        }
    }
}
