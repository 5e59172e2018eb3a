//! Models on the graphics card: the triangles of all that a picture needs, foliage from large triangles to small ones.

use bytemuck::{Pod, Zeroable};

use super::draw_list::{Detail, Item};
use super::vector::Vec3;
use super::world::World;
use crate::tree::archetype::LEVELS;
use crate::tree::mesh::{Material, Mesh, MeshPart};

/// A vertex of a model, as the WGSL text has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[allow(missing_docs, reason = "the text tells what the fields are")]
pub struct ModelCorner {
    pub position: [f32; 3],
    pub pad_a: u32,
    pub normal: [f32; 3],
    pub pad_b: u32,
}

/// A triangle of a model, as the WGSL text has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[allow(missing_docs, reason = "the text tells what the fields are")]
pub struct Triangle {
    pub corners: [u32; 3],
    pub number_and_surface: u32,
}

/// Triangles of foliage that are about as large as each other.
#[derive(Clone, Debug)]
pub struct Run {
    /// Its first triangle in [`Models::triangles`].
    pub first: u32,
    /// Areas of its triangles over the model's planes of y and z, x and z, x and y.
    pub areas: Vec<Vec3>,
}

/// A level of a model.
#[derive(Clone, Debug, Default)]
pub struct Model {
    /// First and number of the triangles of bark, wood and soil.
    pub solid: [u32; 2],
    /// First and number of those of foliage.
    pub foliage: [u32; 2],
    /// The latter again, the largest first.
    pub runs: Vec<Run>,
}

/// The models that a picture needs.
#[derive(Debug, Default)]
pub struct Models {
    /// Vertices of all.
    pub corners: Vec<ModelCorner>,
    /// Triangles of all.
    pub triangles: Vec<Triangle>,
    /// Levels of archetypes, [`LEVELS`] each; those that are not needed are empty.
    pub models: Vec<Model>,
}

/// Largest area in a run over the smallest. chosen: where leaves are few, rounding them up costs more than this.
const RUN_RATIO: f32 = 1.5;

/// The code of a part's surface in the words of samples: those of parts follow the other five.
pub fn surface_code(material: Material) -> u32 {
    5 + material as u32 // a handful
}

/// Place of an item's model in [`Models::models`]; `None` of a splat.
#[inline]
pub fn model_of(world: &World<'_>, item: &Item) -> Option<usize> {
    let archetype = world.instances.groups[item.group as usize].archetype;
    match item.detail {
        Detail::Level(level) => Some(archetype * LEVELS + usize::from(level)),
        Detail::Splat => None,
    }
}

impl Models {
    /// The models of items.
    pub fn of(world: &World<'_>, items: &[Item]) -> Self {
        let archetypes = &world.instances.archetypes;
        let mut is_needed = vec![false; archetypes.len() * LEVELS];
        for place in items.iter().filter_map(|item| model_of(world, item)) {
            is_needed[place] = true;
        }
        let mut all = Self::default();
        for (place, is_needed) in is_needed.iter().enumerate() {
            let model = if *is_needed {
                all.model(&archetypes[place / LEVELS].levels[place % LEVELS])
            } else {
                Model::default()
            };
            all.models.push(model);
        }
        all
    }

    fn model(&mut self, mesh: &Mesh) -> Model {
        let mut model = Model { solid: [self.next(), 0], ..Model::default() };
        for part in mesh.parts.iter().filter(|part| part.material != Material::Foliage) {
            self.part(part, 0..part.triangles.len());
        }
        model.solid[1] = self.next() - model.solid[0];
        model.foliage[0] = self.next();
        for part in mesh.parts.iter().filter(|part| part.material == Material::Foliage) {
            let areas: Vec<Vec3> = part.triangles.iter().map(|t| area(part, *t)).collect();
            let mut order: Vec<usize> = (0..areas.len()).collect();
            order.sort_by(|a, b| areas[*b].length().total_cmp(&areas[*a].length()));
            let first = self.next();
            let mut largest = f32::INFINITY;
            for (number, place) in (0..).zip(&order) {
                let area = areas[*place];
                if area.length() * RUN_RATIO < largest || model.runs.is_empty() {
                    largest = area.length();
                    model.runs.push(Run { first: first + number, areas: Vec::new() });
                }
                if let Some(run) = model.runs.last_mut() {
                    run.areas.push(area);
                }
            }
            self.part(part, order);
        }
        model.foliage[1] = self.next() - model.foliage[0];
        model
    }

    /// Adds a part with its triangles in an order.
    fn part(&mut self, part: &MeshPart, order: impl IntoIterator<Item = usize>) {
        let first = self.corners.len() as u32; // models of a forest have some million vertices
        let corners = part.positions.iter().zip(&part.normals);
        self.corners.extend(corners.map(|(position, normal)| ModelCorner {
            position: *position,
            normal: *normal,
            ..ModelCorner::default()
        }));
        let surface = surface_code(part.material);
        self.triangles.extend(order.into_iter().map(|number| Triangle {
            corners: part.triangles[number].map(|corner| first + corner),
            number_and_surface: (number as u32) << 4 | surface, // models have some thousand triangles
        }));
    }

    fn next(&self) -> u32 {
        self.triangles.len() as u32 // models of a forest have some million triangles
    }
}

/// A triangle's area over the planes square to x, y and z.
fn area(part: &MeshPart, triangle: [u32; 3]) -> Vec3 {
    let [a, b, c] = triangle.map(|corner| Vec3::from(part.positions[corner as usize]));
    (b - a).cross(c - a).abs() * 0.5
}
