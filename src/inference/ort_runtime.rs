//! ONNX Runtime, by its own library.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

use ort::environment::Environment;
use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::Tensor;

use super::runtime::{Runtime, Tile};
use super::{InferenceError, Model};

/// The library once loaded: a process has one.
static LOADED: OnceLock<Result<(PathBuf, Environment), (PathBuf, String)>> = OnceLock::new();

/// Loads the library, or tells why it cannot be used.
pub fn load(path: &Path) -> Result<&'static Environment, InferenceError> {
    let loaded = LOADED.get_or_init(|| {
        let problem = |problem: String| (path.to_owned(), problem);
        if !path.is_file() {
            return Err(problem("no such file".to_owned()));
        }
        let builder = ort::init_from(path).map_err(|e| problem(e.to_string()))?;
        let environment = builder.with_name("wildwood").build();
        environment
            .map(|environment| (path.to_owned(), environment))
            .map_err(|e| problem(e.to_string()))
    });
    match loaded {
        Ok((_, environment)) => Ok(environment),
        Err((path, problem)) => {
            Err(InferenceError::Library { path: path.clone(), problem: problem.clone() })
        }
    }
}

pub struct OrtRuntime {
    environment: &'static Environment,
    model: Model,
    /// Sessions of one thread that no tile uses at the moment.
    idle: Mutex<Vec<Session>>,
}

impl OrtRuntime {
    pub fn open(model: &Model, library: &Path) -> Result<Self, InferenceError> {
        let environment = load(library)?;
        let runtime = Self { environment, model: model.clone(), idle: Mutex::default() };
        let first = runtime.session()?;
        runtime.put_back(first);
        Ok(runtime)
    }

    fn session(&self) -> Result<Session, InferenceError> {
        if let Some(session) = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop() {
            return Ok(session);
        }
        let problem = |e: &dyn std::fmt::Display| InferenceError::Model {
            place: self.model.place.clone(),
            runtime: NAME.to_owned(),
            problem: e.to_string(),
        };
        let mut builder = Session::builder(self.environment)
            .map_err(|e| problem(&e))?
            .with_optimization_level(GraphOptimizationLevel::All)
            .map_err(|e| problem(&e))?
            .with_intra_threads(1)
            .map_err(|e| problem(&e))?;
        builder.commit_from_memory(&self.model.bytes).map_err(|e| problem(&e))
    }

    fn put_back(&self, session: Session) {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(session);
    }
}

/// What the scene calls this runtime.
pub const NAME: &str = "ONNX Runtime";

impl Runtime for OrtRuntime {
    fn name(&self) -> &str {
        NAME
    }

    fn run(&self, tile: Tile) -> Result<Vec<f32>, InferenceError> {
        let [rows_inside, cols_inside] = tile.inside();
        let Tile { channels, rows, cols, conditions, noise, .. } = tile;
        let problem = |e: &dyn std::fmt::Display| InferenceError::Run {
            runtime: NAME.to_owned(),
            rows,
            cols,
            problem: e.to_string(),
        };
        let mut session = self.session()?;
        let conditions = Tensor::from_array(([1, channels, rows, cols], conditions));
        let noise = Tensor::from_array(([1, 1, rows, cols], noise));
        let inputs = ort::inputs![
            "conditions" => conditions.map_err(|e| problem(&e))?,
            "noise" => noise.map_err(|e| problem(&e))?,
        ];
        let outputs = session.run(inputs).map_err(|e| problem(&e))?;
        let output =
            outputs.get("height_m").ok_or_else(|| problem(&"it has no output height_m"))?;
        let (shape, height_m) = output.try_extract_tensor::<f32>().map_err(|e| problem(&e))?;
        if height_m.len() != rows_inside * cols_inside {
            return Err(problem(&format!("its output has the shape {shape:?}")));
        }
        let height_m = height_m.to_vec();
        drop(outputs);
        self.put_back(session);
        Ok(height_m)
    }
}
