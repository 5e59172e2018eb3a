//! Boxes around models and their instances.

use super::instances::InstanceGroup;
use crate::tree::archetype::Archetype;
use crate::tree::mesh::Mesh;

/// A box along the axes. Empty where the lower corner lies above the upper one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least coordinates.
    pub low: [f32; 3],
    /// Greatest coordinates.
    pub high: [f32; 3],
}

impl Bounds {
    /// Around nothing.
    pub const EMPTY: Self = Self { low: [f32::MAX; 3], high: [f32::MIN; 3] };

    /// Around this and a point.
    #[must_use]
    pub fn with(self, point: [f32; 3]) -> Self {
        self.union(Self { low: point, high: point })
    }

    /// Around both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self {
            low: std::array::from_fn(|a| self.low[a].min(other.low[a])),
            high: std::array::from_fn(|a| self.high[a].max(other.high[a])),
        }
    }

    /// Around points.
    pub fn of_points(points: &[[f32; 3]]) -> Self {
        points.iter().fold(Self::EMPTY, |bounds, point| bounds.with(*point))
    }

    /// Around a mesh.
    pub fn of_mesh(mesh: &Mesh) -> Self {
        mesh.parts.iter().fold(Self::EMPTY, |all, part| all.union(Self::of_points(&part.positions)))
    }

    /// Around every level of an archetype.
    pub fn of_archetype(archetype: &Archetype) -> Self {
        archetype.levels.iter().fold(Self::EMPTY, |all, mesh| all.union(Self::of_mesh(mesh)))
    }

    /// Whether it holds nothing.
    pub fn is_empty(&self) -> bool {
        self.low[0] > self.high[0]
    }

    /// Around an instance of a model with these bounds.
    #[must_use]
    pub fn of_instance(&self, group: &InstanceGroup, i: usize) -> Self {
        if self.is_empty() {
            return Self::EMPTY.with(group.position_m[i]);
        }
        let turn = rotation_matrix(group.rotation[i]);
        let (scale, place) = (group.scale[i], group.position_m[i]);
        let middle: [f32; 3] =
            std::array::from_fn(|a| 0.5 * (self.low[a] + self.high[a]) * scale[a]);
        let half: [f32; 3] =
            std::array::from_fn(|a| 0.5 * ((self.high[a] - self.low[a]) * scale[a]).abs());
        let row = |a: usize, v: [f32; 3]| turn[a][0] * v[0] + turn[a][1] * v[1] + turn[a][2] * v[2];
        let reach = |a: usize| {
            turn[a][0].abs() * half[0] + turn[a][1].abs() * half[1] + turn[a][2].abs() * half[2]
        };
        Self {
            low: std::array::from_fn(|a| place[a] + row(a, middle) - reach(a)),
            high: std::array::from_fn(|a| place[a] + row(a, middle) + reach(a)),
        }
    }
}

/// Rows of the matrix of a unit quaternion x, y, z, w.
pub fn rotation_matrix([x, y, z, w]: [f32; 4]) -> [[f32; 3]; 3] {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

#[cfg(test)]
mod tests {
    use super::super::example3d::Example;
    use super::*;

    #[test]
    fn a_quarter_turn_takes_x_to_y() {
        let half = 0.5_f32.sqrt();
        let turn = rotation_matrix([0.0, 0.0, half, half]);
        assert!((turn[1][0] - 1.0).abs() < 1e-6 && turn[0][0].abs() < 1e-6);
        assert!((turn[0][1] + 1.0).abs() < 1e-6 && turn[2][2] == 1.0);
    }

    #[test]
    fn boxes_hold_every_vertex_of_every_instance_and_touch_it() {
        let example = Example::new(40);
        for group in &example.instances.groups {
            let archetype = &example.instances.archetypes[group.archetype];
            let model = Bounds::of_archetype(archetype);
            for i in 0..group.row.len() {
                let bounds = model.of_instance(group, i);
                let turn = rotation_matrix(group.rotation[i]);
                let mut around = Bounds::EMPTY;
                for point in
                    archetype.levels.iter().flat_map(|m| &m.parts).flat_map(|p| &p.positions)
                {
                    let scaled: [f32; 3] = std::array::from_fn(|a| point[a] * group.scale[i][a]);
                    around = around.with(std::array::from_fn(|a| {
                        let turned: f32 = (0..3).map(|b| turn[a][b] * scaled[b]).sum();
                        group.position_m[i][a] + turned
                    }));
                }
                for a in 0..3 {
                    assert!(bounds.low[a] <= around.low[a] + 1e-3);
                    assert!(bounds.high[a] >= around.high[a] - 1e-3);
                }
                assert!((bounds.high[2] - around.high[2]).abs() < 1e-3, "turned about z");
            }
        }
    }
}
