//! What models are put together from: tubes, caps, clumps of leaves, skirts of branches.
//!
//! A sculptor works in metres on a plant of typical size, so that round things are round on it; at the end it shrinks the
//! plant to one unit.

use std::f32::consts::TAU;

use glam::Vec3;

use super::mesh::{Material, Mesh, MeshPart};
use crate::math;
use crate::rng::{self, Key, Process};

/// A place or direction: x east, y north, z up.
pub type Vector = [f32; 3];

/// `a` + `factor` · `b`.
pub fn along(a: Vector, factor: f32, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] + factor * b[i])
}

/// `a` − `b`.
pub fn from_to(b: Vector, a: Vector) -> Vector {
    along(a, -1.0, b)
}

fn cross(a: Vector, b: Vector) -> Vector {
    Vec3::from(a).cross(Vec3::from(b)).to_array()
}

/// `a` at length 1; up if it has none.
pub fn unit(a: Vector) -> Vector {
    Vec3::from(a).normalize_or(Vec3::Z).to_array()
}

/// Level direction at an angle from east to north.
pub fn level(angle_rad: f32) -> Vector {
    [math::cos(angle_rad), math::sin(angle_rad), 0.0]
}

/// Two directions square to `d` and to each other, so that the three are right-handed.
fn square_to(d: Vector) -> [Vector; 2] {
    let u = if d[2].abs() > 0.95 {
        unit(along([1.0, 0.0, 0.0], -d[0], d))
    } else {
        unit(cross([0.0, 0.0, 1.0], d))
    };
    [u, cross(d, u)]
}

/// Radius of the corners of a regular polygon whose area is that of a circle of radius 1.
pub fn corner_radius(sides: usize) -> f32 {
    let n = sides as f32; // a few
    (TAU / (n * math::sin(TAU / n))).sqrt()
}

/// Random numbers of one model, always the same ones.
#[derive(Clone, Debug)]
pub struct Dice {
    entity: u64,
    draws: u16,
}

impl Dice {
    /// The dice of a model, by what tells it from others.
    pub fn of(entity: u64) -> Self {
        Self { entity, draws: 0 }
    }

    /// The next number in 0..1.
    pub fn roll(&mut self) -> f32 {
        self.draws = self.draws.wrapping_add(1);
        let process = Process::ModelShape;
        let key = Key { seed: 0, process, year: self.draws, month: 0, entity: self.entity };
        rng::uniforms(key)[0]
    }

    /// The next number between two.
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        math::lerp(low, high, self.roll())
    }
}

/// The golden angle: turns by it never meet.
pub const GOLDEN_RAD: f32 = 2.399_963;
/// How far sprays turn off their clump's surface.
const SPRAY_TILT: f32 = 0.55;
/// How far normals of leaves stray from their clump's. chosen: mottled as seen from some metres, not noisy.
const STRAY: f32 = 0.3;

#[derive(Clone, Debug, Default)]
struct Surface {
    positions: Vec<Vector>,
    normals: Vec<Vector>,
    triangles: Vec<[u32; 3]>,
}

/// A point of a tube's axis, and the radius there.
#[derive(Clone, Copy, Debug)]
pub struct Knot {
    /// Place on the axis.
    pub at: Vector,
    /// Radius; 0 closes the tube in a point.
    pub radius: f32,
}

/// Puts a model together.
#[derive(Clone, Debug, Default)]
pub struct Sculptor {
    surfaces: [Surface; Material::ALL.len()],
}

impl Sculptor {
    fn surface(&mut self, material: Material) -> &mut Surface {
        &mut self.surfaces[material as usize]
    }

    /// Adds a vertex; returns its index in its material.
    pub fn vertex(&mut self, material: Material, position: Vector, normal: Vector) -> u32 {
        let surface = self.surface(material);
        surface.positions.push(position);
        surface.normals.push(unit(normal));
        (surface.positions.len() - 1) as u32 // a model has some hundreds
    }

    /// Adds a triangle of vertices of one material, counter-clockwise seen from outside.
    pub fn triangle(&mut self, material: Material, corners: [u32; 3]) {
        self.surface(material).triangles.push(corners);
    }

    /// Adds a tube around an axis from its first knot to its last. Level rings suit stems, rings square to the axis all else.
    pub fn tube(&mut self, material: Material, knots: &[Knot], sides: usize, level_rings: bool) {
        let [Some(first), Some(last)] = [knots.first(), knots.last()] else { return };
        let ahead = unit(from_to(first.at, last.at));
        let [u, v] =
            if level_rings { [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] } else { square_to(ahead) };
        let corner = corner_radius(sides);
        let rings: Vec<Vec<u32>> = (0..knots.len())
            .map(|i| {
                let Knot { at, radius } = knots[i];
                // how much the surface faces ahead: the more, the faster the tube narrows
                let (before, after) =
                    (knots[i.saturating_sub(1)], knots[(i + 1).min(knots.len() - 1)]);
                let run = Vec3::from(from_to(before.at, after.at)).dot(ahead.into()).max(1e-6);
                let facing = (before.radius - after.radius) / run;
                if radius <= 0.0 {
                    return vec![self.vertex(material, at, ahead)];
                }
                let around = (0..sides).map(|side| {
                    let angle = TAU * side as f32 / sides as f32;
                    let (c, s) = (math::cos(angle), math::sin(angle));
                    std::array::from_fn(|k| c * u[k] + s * v[k])
                });
                around
                    .map(|out| {
                        let normal = along(out, facing, ahead);
                        self.vertex(material, along(at, radius * corner, out), normal)
                    })
                    .collect()
            })
            .collect();
        for pair in rings.windows(2) {
            self.band(material, &pair[0], &pair[1]);
        }
    }

    /// Joins two rings of vertices, the second further ahead; a ring of one vertex is a point.
    pub fn band(&mut self, material: Material, low: &[u32], high: &[u32]) {
        let sides = low.len().max(high.len());
        let at = |ring: &[u32], side: usize| ring[side % ring.len()];
        for side in 0..sides {
            let [a, b] = [at(low, side), at(low, side + 1)];
            let [d, c] = [at(high, side), at(high, side + 1)];
            if low.len() > 1 {
                self.triangle(material, [a, b, if high.len() > 1 { c } else { d }]);
            }
            if high.len() > 1 {
                self.triangle(material, [a, c, d]);
            }
        }
    }

    /// Closes a tube's end: a disc that faces `ahead`, whose middle lies `dent` behind it.
    pub fn cap(&mut self, material: Material, knot: Knot, ahead: Vector, sides: usize, dent: f32) {
        self.broken_cap(material, knot, ahead, sides, &|_| 0.0, dent);
    }

    /// Closes a tube's end with teeth: corner `side` stands `tooth(side)` ahead.
    pub fn broken_cap(
        &mut self,
        material: Material,
        knot: Knot,
        ahead: Vector,
        sides: usize,
        tooth: &dyn Fn(usize) -> f32,
        dent: f32,
    ) {
        let [u, v] = square_to(ahead);
        let corner = knot.radius * corner_radius(sides);
        let middle = self.vertex(material, along(knot.at, -dent, ahead), ahead);
        let ring: Vec<u32> = (0..sides)
            .map(|side| {
                let angle = TAU * side as f32 / sides as f32;
                let (c, s) = (math::cos(angle), math::sin(angle));
                let out = std::array::from_fn(|k| c * u[k] + s * v[k]);
                let place = along(along(knot.at, corner, out), tooth(side), ahead);
                self.vertex(material, place, along(ahead, -0.3, out))
            })
            .collect();
        self.band(material, &ring, &[middle]);
    }

    /// Adds a clump of leaves: an uneven ellipsoid of 8 · `frequency`² triangles.
    pub fn clump(&mut self, clump: &Clump, dice: &mut Dice) {
        let Clump { middle, radii, frequency, unevenness, heart } = *clump;
        let (directions, triangles) = octasphere(frequency);
        let indices: Vec<u32> = directions
            .iter()
            .map(|&direction| {
                let swell = 1.0 + unevenness * dice.between(-1.0, 1.0);
                let place = std::array::from_fn(|k| middle[k] + swell * radii[k] * direction[k]);
                // between the clump's own roundness and the crown's
                let own = unit(std::array::from_fn(|k| direction[k] / radii[k]));
                let normal = along(own, 0.45, unit(from_to(heart, place)));
                // leaves face all ways: light is mottled
                let stray = std::array::from_fn(|_| dice.between(-1.0, 1.0));
                let normal = along(normal, STRAY, stray);
                self.vertex(Material::Foliage, place, normal)
            })
            .collect();
        for corners in triangles {
            self.triangle(Material::Foliage, corners.map(|c| indices[c]));
        }
    }

    /// Strews sprays over a clump: kites with two sides, that stand off it a little to all sides.
    pub fn sprays(&mut self, clump: &Clump, count: usize, dice: &mut Dice) {
        let Clump { middle, radii, heart, .. } = *clump;
        let turn = dice.between(0.0, TAU);
        for i in 0..count {
            // evenly over the sphere, less of its underside
            let up = 1.0 - 1.7 * (i as f32 + 0.5) / count as f32;
            let flat = (1.0 - up * up).max(0.0).sqrt();
            let around = level(turn + GOLDEN_RAD * i as f32);
            let direction = [flat * around[0], flat * around[1], up];
            let far = dice.between(0.8, 1.02);
            let place: Vector = std::array::from_fn(|k| middle[k] + far * radii[k] * direction[k]);
            let crown = unit(from_to(heart, place));
            let own = unit(std::array::from_fn(|k| direction[k] / radii[k]));
            let stray: Vector = std::array::from_fn(|_| dice.between(-1.0, 1.0));
            let facing = unit(along(along(own, 0.35, crown), SPRAY_TILT, stray));
            let [u, v] = square_to(facing);
            let angle = dice.between(0.0, TAU);
            let (c, s) = (math::cos(angle), math::sin(angle));
            let size = 0.43 * (radii[0] + radii[2]) * dice.between(0.8, 1.15);
            let at = |a: f32, b: f32| -> Vector {
                let (x, y) = (a * c - b * s, a * s + b * c);
                std::array::from_fn(|k| place[k] + size * (x * u[k] + y * v[k]))
            };
            let kite = [at(-0.62, 0.0), at(0.1, -0.45), at(0.85, 0.0), at(0.1, 0.45)];
            let light = unit(along(along(own, 0.6, crown), STRAY, stray));
            let material = Material::Foliage;
            let front = kite.map(|p| self.vertex(material, p, light));
            self.triangle(material, [front[0], front[1], front[2]]);
            self.triangle(material, [front[0], front[2], front[3]]);
            let back = kite.map(|p| self.vertex(material, p, along(light, -1.4, facing)));
            self.triangle(material, [back[0], back[2], back[1]]);
            self.triangle(material, [back[0], back[3], back[2]]);
        }
    }

    /// Adds a skirt of branches around the stem: from a point on the axis down to a rim of uneven tips, closed below.
    pub fn skirt(&mut self, skirt: &Skirt, dice: &mut Dice) {
        let Skirt { axis, top_m, rim_m, under_m, radius_m, tips, notch, raggedness } = *skirt;
        let count = if notch > 0.0 { 2 * tips } else { tips };
        let turn = dice.between(0.0, TAU);
        let rim: Vec<Vector> = (0..count)
            .map(|i| {
                let is_tip = notch <= 0.0 || i % 2 == 0;
                let reach = if notch <= 0.0 {
                    1.0
                } else if is_tip {
                    dice.between(1.0 - raggedness, 1.0)
                } else {
                    1.0 - notch
                };
                let wobble = if notch > 0.0 { dice.between(-0.12, 0.12) } else { 0.0 };
                let angle = turn + TAU * (i as f32 + wobble) / count as f32;
                // notches lie higher: branches hang
                let lift = if is_tip { 0.3 * raggedness * dice.roll() } else { 0.3 };
                let height = math::lerp(rim_m, top_m, lift);
                let out = level(angle);
                [axis[0] + reach * radius_m * out[0], axis[1] + reach * radius_m * out[1], height]
            })
            .collect();
        let material = Material::Foliage;
        let tilt = (top_m - rim_m).max(0.0) / radius_m;
        let peak = self.vertex(material, [axis[0], axis[1], top_m], [0.0, 0.0, 1.0]);
        let bottom = self.vertex(material, [axis[0], axis[1], under_m], [0.0, 0.0, -1.0]);
        let facing = |place: Vector, outward: f32, up: f32| {
            let out = unit([place[0] - axis[0], place[1] - axis[1], 0.0]);
            [outward * out[0], outward * out[1], up]
        };
        // the underside is hollow
        let hollow = (under_m - rim_m) / radius_m;
        let upper: Vec<u32> =
            rim.iter().map(|&p| self.vertex(material, p, facing(p, tilt.max(0.35), 1.0))).collect();
        let lower: Vec<u32> =
            rim.iter().map(|&p| self.vertex(material, p, facing(p, -hollow, -1.0))).collect();
        self.band(material, &upper, &[peak]);
        self.band(material, &[bottom], &lower);
    }

    /// Adds a body of revolution that narrows to points at both ends: rings of radius by height, uneven by a share of each.
    pub fn lathe(&mut self, lathe: &Lathe<'_>, dice: &mut Dice) {
        let Lathe { axis, low_m, high_m, rings, sides, unevenness } = *lathe;
        let material = Material::Foliage;
        let mut before = vec![self.vertex(material, [axis[0], axis[1], low_m], [0.0, 0.0, -1.0])];
        for (i, &(height_m, radius_m)) in rings.iter().enumerate() {
            let (low, high) = (
                i.checked_sub(1).map_or((low_m, 0.0), |j| rings[j]),
                rings.get(i + 1).copied().unwrap_or((high_m, 0.0)),
            );
            // half-way between how the surfaces below and above face: out and up
            let faces = |a: (f32, f32), b: (f32, f32)| {
                let (rise, narrowing) = (b.0 - a.0, a.1 - b.1);
                let long = (rise * rise + narrowing * narrowing).sqrt().max(1e-9);
                [rise / long, narrowing / long]
            };
            let (below, above) =
                (faces(low, (height_m, radius_m)), faces((height_m, radius_m), high));
            let [outward, upward] = [0, 1].map(|k| below[k] + above[k]);
            let ring: Vec<u32> = (0..sides)
                .map(|side| {
                    // each ring turned back by half a corner, as bands cut their squares
                    let out = level(TAU * (side as f32 - 0.5 * i as f32) / sides as f32);
                    let reach = radius_m * (1.0 + unevenness * dice.between(-1.0, 1.0));
                    let place = [axis[0] + reach * out[0], axis[1] + reach * out[1], height_m];
                    self.vertex(material, place, [outward * out[0], outward * out[1], upward])
                })
                .collect();
            self.band(material, &before, &ring);
            before = ring;
        }
        let top = self.vertex(material, [axis[0], axis[1], high_m], [0.0, 0.0, 1.0]);
        self.band(material, &before, &[top]);
    }

    /// Flattens everything towards z = 0.
    pub fn flatten(&mut self, factor: f32) {
        for surface in &mut self.surfaces {
            surface.stretch([1.0, 1.0, factor]);
        }
    }

    /// Stretches leaves, so that their greatest distance from the axis and their top are as given.
    pub fn fit_foliage(&mut self, radius_m: f32, height_m: f32) {
        let surface = self.surface(Material::Foliage);
        let places = || surface.positions.iter();
        let wide = places().map(|[x, y, _]| (x * x + y * y).sqrt()).fold(0.0, f32::max);
        let high = places().map(|p| p[2]).fold(0.0, f32::max);
        if wide > 0.0 && high > 0.0 {
            surface.stretch([radius_m / wide, radius_m / wide, height_m / high]);
        }
    }

    /// The model, shrunk by the given sizes.
    pub fn into_mesh(self, size_m: Vector) -> Mesh {
        let parts = Material::ALL.into_iter().zip(self.surfaces);
        let parts = parts.filter(|(_, surface)| !surface.triangles.is_empty());
        Mesh {
            parts: parts
                .map(|(material, mut surface)| {
                    surface.stretch(size_m.map(|size| 1.0 / size));
                    let Surface { positions, normals, triangles } = surface;
                    MeshPart { material, positions, normals, triangles }
                })
                .collect(),
        }
    }
}

impl Surface {
    fn stretch(&mut self, factors: Vector) {
        for place in &mut self.positions {
            *place = std::array::from_fn(|k| place[k] * factors[k]);
        }
        for normal in &mut self.normals {
            *normal = unit(std::array::from_fn(|k| normal[k] / factors[k]));
        }
    }
}

/// An uneven ellipsoid of leaves.
#[derive(Clone, Copy, Debug)]
pub struct Clump {
    /// Its middle.
    pub middle: Vector,
    /// Its half axes.
    pub radii: Vector,
    /// Edges along a quarter of its girth.
    pub frequency: usize,
    /// How far its surface rises and falls, as a share of its radius.
    pub unevenness: f32,
    /// Middle of the crown, which light falls around.
    pub heart: Vector,
}

/// A skirt of branches.
#[derive(Clone, Copy, Debug)]
pub struct Skirt {
    /// Where the stem is.
    pub axis: [f32; 2],
    /// Height of its middle above.
    pub top_m: f32,
    /// Height of its tips.
    pub rim_m: f32,
    /// Height of its middle below.
    pub under_m: f32,
    /// Its reach.
    pub radius_m: f32,
    /// Number of tips.
    pub tips: usize,
    /// How deep the rim is cut between tips, as a share of the reach; 0 for a plain rim.
    pub notch: f32,
    /// How unequal its tips are: the share that the shortest lack.
    pub raggedness: f32,
}

/// A body of revolution.
#[derive(Clone, Copy, Debug)]
pub struct Lathe<'a> {
    /// Where the stem is.
    pub axis: [f32; 2],
    /// Height of its lowest point.
    pub low_m: f32,
    /// Height of its highest point.
    pub high_m: f32,
    /// Heights and radii of its rings, from below.
    pub rings: &'a [(f32, f32)],
    /// Corners of a ring.
    pub sides: usize,
    /// How far its surface rises and falls, as a share of its radius.
    pub unevenness: f32,
}

/// A sphere of radius 1 from an octahedron whose edges are cut `frequency` times: vertices and triangles.
fn octasphere(frequency: usize) -> (Vec<Vector>, Vec<[usize; 3]>) {
    let n = frequency.max(1) as i32; // a few
    let mut places: Vec<[i32; 3]> = Vec::new();
    let mut triangles = Vec::new();
    let mut index = |place: [i32; 3]| {
        places.iter().position(|p| *p == place).unwrap_or_else(|| {
            places.push(place);
            places.len() - 1
        })
    };
    for octant in 0..8 {
        let sign = [0, 1, 2].map(|axis| if octant >> axis & 1 == 0 { 1 } else { -1 });
        let is_mirrored = sign[0] * sign[1] * sign[2] < 0;
        let mut corner = |i: i32, j: i32| index([sign[0] * i, sign[1] * j, sign[2] * (n - i - j)]);
        let mut add = |[a, b, c]: [usize; 3]| {
            triangles.push(if is_mirrored { [a, c, b] } else { [a, b, c] });
        };
        for i in 0..n {
            for j in 0..n - i {
                add([corner(i + 1, j), corner(i, j + 1), corner(i, j)]);
                if i + j + 1 < n {
                    add([corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)]);
                }
            }
        }
    }
    (places.into_iter().map(|p| unit(p.map(|v| v as f32))).collect(), triangles)
}
