//! State of a forest: what a run goes on from, bit for bit.

use super::outbreaks::Outbreak;
use super::run::Forest;
use super::tally::Tally;
use crate::plants::deadwood::{LifeEvent, TimelineRow};
use crate::simulation::community::{CommunityState, CommunityStateRef};
use crate::simulation::deadwood::Stock;

/// All that a forest is but its ground, which follows from the scene.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct State {
    community: CommunityState,
    stock: Stock,
    outbreaks: Vec<Outbreak>,
    outbreak_count: u32,
    history: Vec<LifeEvent>,
    timeline: Vec<TimelineRow>,
    tally: Tally,
    burnt_m2: Vec<(u16, f32)>,
}

/// A state that is lent, field by field as [`State`]: what is written of one is read as the other.
#[derive(Clone, Debug, serde::Serialize)]
pub struct StateRef<'a> {
    community: CommunityStateRef<'a>,
    stock: &'a Stock,
    outbreaks: &'a [Outbreak],
    outbreak_count: u32,
    history: &'a [LifeEvent],
    timeline: &'a [TimelineRow],
    tally: Tally,
    burnt_m2: &'a [(u16, f32)],
}

impl Forest {
    /// What it is.
    pub fn state(&self) -> StateRef<'_> {
        StateRef {
            community: self.community.state(),
            stock: &self.stock,
            outbreaks: &self.outbreaks,
            outbreak_count: self.outbreak_count,
            history: &self.history,
            timeline: &self.timeline,
            tally: self.tally,
            burnt_m2: &self.burnt_m2,
        }
    }

    /// Goes on from a state on the same ground; gives whether it can: not if it is damaged or of another biome.
    pub fn set_state(&mut self, state: State) -> bool {
        let is_known = |species: &u16| usize::from(*species) < self.biome.species.len();
        let wood = state.stock.snags.iter().map(|snag| &snag.species);
        let mut all =
            wood.chain(state.stock.downed_logs.iter().map(|downed_log| &downed_log.species));
        if !all.all(is_known) || !self.community.set_state(state.community) {
            return false;
        }
        self.stock = state.stock;
        self.outbreaks = state.outbreaks;
        self.outbreak_count = state.outbreak_count;
        self.history = state.history;
        self.timeline = state.timeline;
        self.tally = state.tally;
        self.burnt_m2 = state.burnt_m2;
        self.mark_downed_logs();
        true
    }
}
