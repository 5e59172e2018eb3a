//! State of a community: what a run goes on from, bit for bit.

use super::Community;

/// Measures of a plant.
const MEASURES: usize = 10;

/// All that a community is but its plot.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct CommunityState {
    year: u16,
    first_seedling_id: u64,
    id: Vec<u64>,
    species: Vec<u16>,
    /// Measures in the order of the community's arrays.
    measures: [Vec<f32>; MEASURES],
}

/// A state that is lent, field by field as [`CommunityState`].
#[derive(Clone, Debug, serde::Serialize)]
pub struct CommunityStateRef<'a> {
    year: u16,
    first_seedling_id: u64,
    id: &'a [u64],
    species: &'a [u16],
    measures: [&'a Vec<f32>; MEASURES],
}

impl Community {
    /// All that it is but its plot.
    pub fn state(&self) -> CommunityStateRef<'_> {
        CommunityStateRef {
            year: self.year,
            first_seedling_id: self.first_seedling_id,
            id: &self.id,
            species: &self.species,
            measures: self.measures(),
        }
    }

    /// Goes on from a state. Gives whether it can be one.
    pub fn set_state(&mut self, state: CommunityState) -> bool {
        let plants = state.id.len();
        let is_whole = state.species.len() == plants
            && state.species.iter().all(|species| usize::from(*species) < self.traits.len())
            && state.measures[..6].iter().all(|values| values.len() == plants)
            && state.measures[6..]
                .iter()
                .all(|values| values.len() == if self.is_whole_forest { plants } else { 0 });
        if is_whole {
            (self.year, self.first_seedling_id) = (state.year, state.first_seedling_id);
            (self.id, self.species) = (state.id, state.species);
            [
                self.east_m,
                self.south_m,
                self.idealized_age_years,
                self.carbon_pool,
                self.height_m,
                self.crown_radius_m,
                self.dbh_m,
                self.vigor,
                self.crowding_fraction,
                self.acclimation,
            ] = state.measures;
        }
        is_whole
    }

    pub(super) fn measures(&self) -> [&Vec<f32>; MEASURES] {
        [
            &self.east_m,
            &self.south_m,
            &self.idealized_age_years,
            &self.carbon_pool,
            &self.height_m,
            &self.crown_radius_m,
            &self.dbh_m,
            &self.vigor,
            &self.crowding_fraction,
            &self.acclimation,
        ]
    }
}
