//! `rten`: the runtime that is always there.

use std::sync::{Arc, Mutex, PoisonError};

use rten::{Model as RtenModel, RunOptions, ThreadPool};
use rten_tensor::NdTensor;
use rten_tensor::prelude::*;

use super::runtime::{Runtime, Tile};
use super::{InferenceError, Model};

/// What the scene calls this runtime.
pub const NAME: &str = "rten 0.27";

pub struct RtenRuntime {
    model: RtenModel,
    conditions: rten::NodeId,
    noise: rten::NodeId,
    output: rten::NodeId,
    /// Pools of one thread that no tile uses at the moment: tiles are what runs in parallel.
    idle: Mutex<Vec<Arc<ThreadPool>>>,
}

impl RtenRuntime {
    pub fn open(model: &Model) -> Result<Self, InferenceError> {
        let problem = |problem: String| InferenceError::Model {
            place: model.place.clone(),
            runtime: NAME.to_owned(),
            problem,
        };
        let loaded = RtenModel::load(model.bytes.to_vec()).map_err(|e| problem(e.to_string()))?;
        let id = |name: &str| loaded.node_id(name).map_err(|e| problem(e.to_string()));
        let (conditions, noise, output) = (id("conditions")?, id("noise")?, id("height_m")?);
        Ok(Self { model: loaded, conditions, noise, output, idle: Mutex::default() })
    }
}

impl Runtime for RtenRuntime {
    fn name(&self) -> &str {
        NAME
    }

    fn run(&self, tile: Tile) -> Result<Vec<f32>, InferenceError> {
        let [rows_inside, cols_inside] = tile.inside();
        let Tile { channels, rows, cols, conditions, noise, .. } = tile;
        let problem =
            |problem: String| InferenceError::Run { runtime: NAME.to_owned(), rows, cols, problem };
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let pool = idle().pop();
        let pool = pool.unwrap_or_else(|| Arc::new(ThreadPool::with_num_threads(1)));
        let options = RunOptions::default().with_thread_pool(Some(Arc::clone(&pool)));
        let conditions = NdTensor::from_data([1, channels, rows, cols], conditions);
        let noise = NdTensor::from_data([1, 1, rows, cols], noise);
        let inputs = vec![(self.conditions, conditions.into()), (self.noise, noise.into())];
        let outputs = self.model.run_n(inputs, [self.output], Some(options));
        idle().push(pool);
        let [height_m] = outputs.map_err(|e| problem(e.to_string()))?;
        let height_m: NdTensor<f32, 4> =
            height_m.try_into().map_err(|_| problem("its output is no map".to_owned()))?;
        if height_m.shape() != [1, 1, rows_inside, cols_inside] {
            return Err(problem(format!("its output has the shape {:?}", height_m.shape())));
        }
        Ok(height_m.to_vec())
    }
}
