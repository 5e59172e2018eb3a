//! Disease: who catches it from whom, month by month; plants are susceptible, infected or immune.
//!
//! Each disease has its hosts' health to itself, so several run at once, even in one species.
//!
//! # Reference
//! Peytavie et al. 2024, section 5.3.3, doi:10.1145/3641816.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::contagion::{Carrier, CrownSums};
use crate::math;
use crate::rng::{self, Key, Process};

/// A number of months that never ends.
pub const FOR_EVER_MONTHS: u16 = u16::MAX;

/// A disease of one species.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Disease {
    /// Number of the species.
    pub species: u16,
    /// Where it breaks out: share of the plot's width from its west side.
    pub east_fraction: f32,
    /// Where it breaks out: share of the plot's height from its south side.
    pub north_fraction: f32,
    /// How far an infected plant infects others (r_spread).
    pub spread_radius_m: f32,
    /// Chance to catch it among infected crowns that cover the whole surroundings (P_spread).
    pub spread_probability_per_month: f32,
    /// What it takes from an infected plant's carbon pool (v_disease).
    pub severity_per_month: f32,
    /// How long an infected plant infects others (m_contagious).
    pub contagious_months: u16,
    /// How long it is infected (m_recover); [`FOR_EVER_MONTHS`] if it never recovers.
    pub recovery_months: u16,
    /// How long it is immune afterwards (m_immune); may be [`FOR_EVER_MONTHS`].
    pub immune_months: u16,
    /// Share of the hosts within the spread radius that an outbreak infects.
    pub first_infected_fraction: f32,
}

/// Radius in which a disease breaks out, in spread radii. chosen: s(d) lets few plants infect nobody, so that an outbreak which is no
/// wider than its reach dies out at its rim.
const OUTBREAK_RADII: f32 = 4.0;
/// Share of a species' plants near that are ill where contagion is as likely as it gets. chosen: with it the moth of the authors'
/// script (P_spread 0.3) has one great wave and settles at a level, as in their Fig. 13.
const FULL_FRACTION: f32 = 0.8;
/// Cover of a species below which its plants are too far apart for each other. chosen: saplings at a distance of ten crowns.
const LEAST_HOSTS_FRACTION: f32 = 0.01;

/// How a plant fares with a disease.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Health {
    /// May catch it.
    #[default]
    Susceptible,
    /// Has it.
    Infected {
        /// Months since it caught it.
        months: u16,
    },
    /// Had it, and cannot catch it.
    Immune {
        /// Months since it recovered.
        months: u16,
    },
}

impl Health {
    /// Whether it has it.
    pub fn is_infected(self) -> bool {
        matches!(self, Self::Infected { .. })
    }
}

/// Live plants of a disease's species, in any order; one entry of each list per plant.
#[derive(Clone, Copy, Debug)]
pub struct Hosts<'a> {
    /// Number that a plant keeps for life.
    pub id: &'a [u64],
    /// Distance from the plot's west side.
    pub east_m: &'a [f32],
    /// Distance from the plot's north side.
    pub south_m: &'a [f32],
    /// Radius of the crown.
    pub crown_radius_m: &'a [f32],
}

/// What a month changed, as indices of hosts in rising order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Month {
    /// Hosts that caught the disease.
    pub infected: Vec<u32>,
    /// Hosts that recovered from it.
    pub recovered: Vec<u32>,
}

/// Infects the first hosts and returns their indices: a share of those within four spread radii of the place of outbreak.
///
/// If that infects none, the susceptible host nearest to the place. `plot_m` is the plot's size east and south, `number` the
/// disease's own.
#[expect(clippy::too_many_arguments, reason = "the parts of the draws' key")]
pub fn outbreak(
    disease: &Disease,
    hosts: &Hosts,
    plot_m: [f32; 2],
    health: &mut [Health],
    seed: u64,
    year: u16,
    month: u8,
    number: u32,
) -> Vec<u32> {
    assert_eq!(hosts.id.len(), health.len(), "each host has a health");
    let place_east_m = disease.east_fraction * plot_m[0];
    let place_south_m = (1.0 - disease.north_fraction) * plot_m[1];
    let distance2_m2 = |host: u32| {
        let right_m = hosts.east_m[host as usize] - place_east_m;
        let down_m = hosts.south_m[host as usize] - place_south_m;
        right_m * right_m + down_m * down_m
    };
    let outbreak_m = OUTBREAK_RADII * disease.spread_radius_m;
    let susceptible =
        || indices(health).filter(|&host| health[host as usize] == Health::Susceptible);
    let mut first: Vec<u32> = susceptible()
        .filter(|&host| {
            distance2_m2(host) <= outbreak_m * outbreak_m
                && draws(seed, year, month, number, hosts.id[host as usize])[1]
                    < disease.first_infected_fraction
        })
        .collect();
    if first.is_empty() {
        let order = |&a: &u32, &b: &u32| {
            let by_id = hosts.id[a as usize].cmp(&hosts.id[b as usize]);
            distance2_m2(a).total_cmp(&distance2_m2(b)).then(by_id)
        };
        first.extend(susceptible().min_by(order));
    }
    for &host in &first {
        health[host as usize] = Health::Infected { months: 0 };
    }
    first
}

/// Lets a month pass: the susceptible may catch the disease, the infected recover, the immune become susceptible.
///
/// Who catches it is settled by the month's beginning, so a plant infects others from the month after its own infection, for
/// the contagious months; it recovers, and loses its immunity, in the last of the months named.
///
/// # Reference
/// Peytavie et al. 2024, section 5.3.3: P_i = P_spread s(d_i), d_i the density of infected neighbours, which are the contagious.
/// # Departures
/// d_i is Σ r_j² of the contagious over that of all of the species' plants within the radius, and over a hundredth of
/// r_spread² at least; printed, over r_spread². Printed, no disease spreads in a mixed forest, where a species covers a fraction
/// of the ground: the authors' program ran four times as much (PAPER_NOTES §10), and the moth of their script dies out here
/// within a year.
pub fn live_a_month(
    disease: &Disease,
    hosts: &Hosts,
    health: &mut [Health],
    seed: u64,
    year: u16,
    month: u8,
    number: u32,
) -> Month {
    assert_eq!(hosts.id.len(), health.len(), "each host has a health");
    let most = |values: &[f32]| values.iter().copied().fold(0.0, f32::max);
    let reach_m = [most(hosts.east_m), most(hosts.south_m)];
    let radius_m = disease.spread_radius_m;
    let ill = CrownSums::new(radius_m, reach_m, carriers(disease, hosts, health));
    let all = CrownSums::new(radius_m, reach_m, (0..health.len()).map(|host| hosts.carrier(host)));
    let seen: &[Health] = health;
    let catches = |&host: &u32| {
        let index = host as usize;
        if seen[index] != Health::Susceptible {
            return false;
        }
        let [east_m, south_m] = [hosts.east_m[index], hosts.south_m[index]];
        let hosts_m2 =
            all.around_m2(east_m, south_m).max(LEAST_HOSTS_FRACTION * radius_m * radius_m);
        let density = (ill.around_m2(east_m, south_m) / (FULL_FRACTION * hosts_m2)).min(1.0);
        let probability = disease.spread_probability_per_month * math::smoothstep(density);
        probability > 0.0 && draws(seed, year, month, number, hosts.id[index])[0] < probability
    };
    // u32 indices: a plot has fewer than 2³² plants
    let infected: Vec<u32> = (0..seen.len() as u32).into_par_iter().filter(catches).collect();
    let mut recovered = Vec::new();
    for (host, state) in health.iter_mut().enumerate() {
        let was_infected = matches!(state, Health::Infected { .. });
        *state = state.a_month_later(disease);
        if was_infected && !matches!(state, Health::Infected { .. }) {
            recovered.push(host as u32);
        }
    }
    for &host in &infected {
        health[host as usize] = Health::Infected { months: 0 };
    }
    Month { infected, recovered }
}

impl Health {
    /// The health a month later of a plant that does not catch the disease.
    fn a_month_later(self, disease: &Disease) -> Self {
        let over = |months: u16, span: u16| span != FOR_EVER_MONTHS && months >= span;
        match self {
            Self::Infected { months } => {
                let months = months.saturating_add(1);
                if !over(months, disease.recovery_months) {
                    Self::Infected { months }
                } else if disease.immune_months == 0 {
                    Self::Susceptible
                } else {
                    Self::Immune { months: 0 }
                }
            }
            Self::Immune { months } => {
                let months = months.saturating_add(1);
                if over(months, disease.immune_months) {
                    Self::Susceptible
                } else {
                    Self::Immune { months }
                }
            }
            Self::Susceptible => Self::Susceptible,
        }
    }
}

/// The hosts that infect others.
fn carriers(disease: &Disease, hosts: &Hosts, health: &[Health]) -> impl Iterator<Item = Carrier> {
    let is_contagious = |host: &usize| match health[*host] {
        Health::Infected { months } => months < disease.contagious_months,
        _ => false,
    };
    (0..health.len()).filter(is_contagious).map(|host| hosts.carrier(host))
}

impl Hosts<'_> {
    fn carrier(&self, host: usize) -> Carrier {
        Carrier {
            east_m: self.east_m[host],
            south_m: self.south_m[host],
            crown_radius_m: self.crown_radius_m[host],
        }
    }
}

fn indices(health: &[Health]) -> impl Iterator<Item = u32> {
    0..health.len() as u32 // a plot has fewer than 2³² plants
}

/// Draws of a plant in a month: the first for catching the disease, the second for its outbreak.
///
/// The disease's number times an odd constant is laid over the plant's id: no two diseases share the entities of a plant.
fn draws(seed: u64, year: u16, month: u8, number: u32, id: u64) -> [f32; 4] {
    // 2⁶⁴ by the golden ratio
    let entity = id ^ u64::from(number).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    rng::uniforms(Key { seed, process: Process::Disease, year, month, entity })
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOTH: Disease = Disease {
        species: 0,
        east_fraction: 0.5,
        north_fraction: 0.5,
        spread_radius_m: 50.0,
        spread_probability_per_month: 0.3,
        severity_per_month: 0.25,
        contagious_months: 12,
        recovery_months: 12,
        immune_months: 12,
        first_infected_fraction: 0.3,
    };

    struct Stand {
        id: Vec<u64>,
        east_m: Vec<f32>,
        south_m: Vec<f32>,
        crown_radius_m: Vec<f32>,
        side_m: f32,
    }

    impl Stand {
        fn new(count: u64, side_m: f32, crown_radius_m: f32) -> Self {
            let key =
                |entity| Key { seed: 8, process: Process::StrewnPoints, year: 0, month: 0, entity };
            let at = |axis: usize| {
                (0..count).map(|id| rng::uniforms(key(id))[axis] * side_m).collect::<Vec<f32>>()
            };
            let radius = |id| crown_radius_m * (0.5 + rng::uniforms(key(id))[2]);
            Self {
                id: (0..count).collect(),
                east_m: at(0),
                south_m: at(1),
                crown_radius_m: (0..count).map(radius).collect(),
                side_m,
            }
        }

        fn hosts(&self) -> Hosts<'_> {
            Hosts {
                id: &self.id,
                east_m: &self.east_m,
                south_m: &self.south_m,
                crown_radius_m: &self.crown_radius_m,
            }
        }

        /// Shares infected, month by month, and the last health.
        fn run(&self, disease: &Disease, months: u16) -> (Vec<f32>, Vec<Health>) {
            let mut health = vec![Health::Susceptible; self.id.len()];
            outbreak(disease, &self.hosts(), [self.side_m; 2], &mut health, 5, 0, 1, 3);
            let share = (0..months).map(|time| {
                let (year, month) = (time / 12, (time % 12 + 1) as u8);
                live_a_month(disease, &self.hosts(), &mut health, 5, year, month, 3);
                health.iter().filter(|state| is_infected(state)).count() as f32
                    / health.len() as f32
            });
            (share.collect(), health)
        }
    }

    fn is_infected(state: &Health) -> bool {
        matches!(state, Health::Infected { .. })
    }

    #[test]
    fn all_catch_it_where_infected_crowns_cover_all_and_none_without_spread() {
        let stand = Stand::new(2000, 100.0, 4.0);
        let certain = Disease { spread_probability_per_month: 1.0, ..MOTH };
        let lasting = Disease { recovery_months: FOR_EVER_MONTHS, ..certain };
        assert_eq!(stand.run(&lasting, 12).0[11], 1.0);
        let still = Disease { spread_probability_per_month: 0.0, spread_radius_m: 20.0, ..lasting };
        let (shares, _) = stand.run(&still, 12);
        assert!(shares[0] > 0.0 && shares[11] == shares[0]);
    }

    #[test]
    fn plants_recover_then_lose_their_immunity() {
        let disease = Disease { recovery_months: 3, immune_months: 2, ..MOTH };
        let mut state = Health::Infected { months: 0 };
        let mut course = Vec::new();
        for _ in 0..5 {
            state = state.a_month_later(&disease);
            course.push(state);
        }
        let infected = [1, 2].map(|months| Health::Infected { months });
        let immune = [0, 1].map(|months| Health::Immune { months });
        assert_eq!(course[..2], infected);
        assert_eq!(course[2..4], immune);
        assert_eq!(course[4], Health::Susceptible);
        let never = Disease { recovery_months: FOR_EVER_MONTHS, ..disease };
        let ill = Health::Infected { months: u16::MAX };
        assert_eq!(ill.a_month_later(&never), ill);
        assert_eq!(size_of::<Health>(), 4);
    }

    #[test]
    fn only_the_contagious_months_spread_it() {
        let stand = Stand::new(500, 60.0, 4.0);
        let certain = Disease { spread_probability_per_month: 1.0, contagious_months: 2, ..MOTH };
        let infected_after = |months| {
            let mut health = vec![Health::Susceptible; 500];
            health[..450].fill(Health::Infected { months });
            live_a_month(&certain, &stand.hosts(), &mut health, 1, 1, 1, 1).infected.len()
        };
        // nine of ten ill are more than FULL_FRACTION: all others catch it
        assert_eq!((infected_after(1), infected_after(2)), (50, 0));
    }

    #[test]
    fn an_outbreak_infects_a_share_or_the_nearest() {
        let stand = Stand::new(20_000, 400.0, 2.0);
        let first = |disease: &Disease| {
            let mut health = vec![Health::Susceptible; 20_000];
            let first = outbreak(disease, &stand.hosts(), [400.0; 2], &mut health, 5, 3, 1, 0);
            assert_eq!(health.iter().filter(|state| is_infected(state)).count(), first.len());
            first
        };
        // π (4 · 50)² m² hold 15,708 of 20,000 plants on 16 ha; 3 σ of a tenth of them is 113
        let tenth = first(&Disease { first_infected_fraction: 0.1, ..MOTH });
        assert!((tenth.len() as f32 - 1571.0).abs() < 150.0, "{}", tenth.len());
        assert_eq!(first(&Disease { first_infected_fraction: 0.0, ..MOTH }).len(), 1);
    }

    #[test]
    fn waves_damp_towards_an_endemic_level() {
        // on 36 ha without deaths and births, a year's immunity leaves the moth of the script too few to infect
        let stand = Stand::new(20_000, 600.0, 4.0);
        let disease = Disease { immune_months: 6, ..MOTH };
        let (shares, _) = stand.run(&disease, 300);
        let swing = |months: &[f32]| {
            let highest = months.iter().copied().fold(0.0, f32::max);
            (highest, highest - months.iter().copied().fold(1.0, f32::min))
        };
        let (first_peak, first_swing) = swing(&shares[..60]);
        let (_, late_swing) = swing(&shares[240..]);
        let level = shares[240..].iter().sum::<f32>() / 60.0;
        assert!(first_peak > level && level > 0.3, "{first_peak} {level}");
        assert!(first_swing > 4.0 * late_swing, "{first_swing} {late_swing}");
    }

    #[test]
    fn any_order_of_hosts_gives_the_same_bits() {
        let stand = Stand::new(3000, 200.0, 3.0);
        let order: Vec<usize> = (0..3000).map(|index| index * 1009 % 3000).collect();
        let pick = |list: &[f32]| order.iter().map(|&host| list[host]).collect();
        let shuffled = Stand {
            id: order.iter().map(|&host| stand.id[host]).collect(),
            east_m: pick(&stand.east_m),
            south_m: pick(&stand.south_m),
            crown_radius_m: pick(&stand.crown_radius_m),
            side_m: 200.0,
        };
        let (shares, health) = stand.run(&MOTH, 10);
        let (shuffled_shares, shuffled_health) = shuffled.run(&MOTH, 10);
        assert_eq!(shares, shuffled_shares);
        assert!(shares[9] > shares[0] && shares[9] < 1.0);
        assert!((0..3000).all(|index| shuffled_health[index] == health[order[index]]));
    }

    #[test]
    fn diseases_have_draws_of_their_own() {
        assert_ne!(draws(1, 2, 3, 0, 77), draws(1, 2, 3, 1, 77));
        assert_eq!(draws(1, 2, 3, 1, 77), draws(1, 2, 3, 1, 77));
    }
}
