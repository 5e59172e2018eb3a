//! Disks: plants from above.

/// Plants from above, one array a measure, in metres from the north-west corner.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Disks {
    /// Index into the biome's species.
    pub species: Vec<u16>,
    /// Metres east.
    pub east_m: Vec<f32>,
    /// Metres south.
    pub south_m: Vec<f32>,
    /// Crown radius.
    pub radius_m: Vec<f32>,
    /// Height.
    pub height_m: Vec<f32>,
}

impl Disks {
    /// Number of plants.
    pub fn len(&self) -> usize {
        self.species.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.species.is_empty()
    }

    /// Adds a plant.
    pub fn push(
        &mut self,
        species: u16,
        [east_m, south_m]: [f32; 2],
        radius_m: f32,
        height_m: f32,
    ) {
        self.species.push(species);
        self.east_m.push(east_m);
        self.south_m.push(south_m);
        self.radius_m.push(radius_m);
        self.height_m.push(height_m);
    }

    /// Radius of the widest, 0 if there is none.
    pub fn widest_m(&self) -> f32 {
        self.radius_m.iter().copied().fold(0.0, f32::max)
    }
}
