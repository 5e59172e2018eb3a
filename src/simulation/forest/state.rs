//! State of a forest: what a run goes on from, bit for bit.

use super::outbreaks::Outbreak;
use super::run::Forest;
use super::tally::Tally;
use crate::plants::deadwood::{LifeEvent, TimelineRow};
use crate::simulation::community::CommunityState;
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

impl Forest {
    /// What it is.
    pub fn state(&self) -> State {
        State {
            community: self.community.state(),
            stock: self.stock.clone(),
            outbreaks: self.outbreaks.clone(),
            outbreak_count: self.outbreak_count,
            history: self.history.clone(),
            timeline: self.timeline.clone(),
            tally: self.tally,
            burnt_m2: self.burnt_m2.clone(),
        }
    }

    /// Goes on from a state on the same ground; none if it is damaged or of another biome.
    pub fn with_state(mut self, state: State) -> Option<Self> {
        let is_known = |species: &u16| usize::from(*species) < self.biome.species.len();
        let wood = state.stock.snags.iter().map(|snag| &snag.species);
        let all = wood.chain(state.stock.downed_logs.iter().map(|downed_log| &downed_log.species));
        if !all.into_iter().all(is_known) || !self.community.set_state(state.community) {
            return None;
        }
        self.stock = state.stock;
        self.outbreaks = state.outbreaks;
        self.outbreak_count = state.outbreak_count;
        self.history = state.history;
        self.timeline = state.timeline;
        self.tally = state.tally;
        self.burnt_m2 = state.burnt_m2;
        self.mark_downed_logs();
        Some(self)
    }
}
