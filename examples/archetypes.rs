//! Draws the models of a biome on a sheet: `archetypes BIOME SHEET.png [PIXELS [LEVEL [KEY]]]`, a row a species, each model as large as a plant that it may
//! stand for. PIXELS is the side of a model's field, LEVEL 0 (near) to 2 (far), KEY a species.

use std::collections::BTreeMap;
use std::error::Error;

use image::{Rgb, RgbImage};
use wildwood::plants::deadwood::DownedLogKind;
use wildwood::species::{Biome, Form, Species};
use wildwood::tree::archetype::Archetype;
use wildwood::tree::atlas::{Atlas, DownedLogMeasures, Fitting, PlantMeasures, SnagMeasures};
use wildwood::tree::low_poly::LowPolyAtlas;

/// Pixels drawn for each shown, to both sides.
const OVERSAMPLING: u32 = 3;
const PAPER: [f32; 3] = [226.0, 230.0, 232.0];
/// Where light comes from, and the viewer's direction: slightly from above.
const LAMP: [f32; 3] = [-0.52, -0.55, 0.65];
const VIEW_RAD: f32 = 0.16;

struct Sheet {
    width: usize,
    height: usize,
    color: Vec<[f32; 3]>,
    depth: Vec<f32>,
}

/// A field of the sheet, in pixels, and the size in metres that fills it.
struct Field {
    left: f32,
    bottom: f32,
    px_per_m: f32,
    middle_m: f32,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, path, rest @ ..] = arguments.as_slice() else {
        return Err("usage: archetypes BIOME SHEET.png [PIXELS [LEVEL [KEY]]]".into());
    };
    let side: u32 = rest.first().map_or(Ok(150), |text| text.parse())?;
    let level: usize = rest.get(1).map_or(Ok(0), |text| text.parse())?;
    let biome = Biome::builtin(name)?;
    let atlas = LowPolyAtlas::new(&biome);
    let is_shown = |species: &&(u16, &Species)| rest.get(2).is_none_or(|key| *key == species.1.key);
    let all: Vec<(u16, &Species)> = (0..).zip(&biome.species).collect();
    let rows: Vec<Vec<Fitting>> = all
        .iter()
        .filter(is_shown)
        .map(|(index, species)| fittings(&atlas, *index, species))
        .collect();
    let columns = rows.iter().map(Vec::len).max().unwrap_or(1);
    let field_px = (side * OVERSAMPLING) as usize;
    let (width, height) = (columns * field_px, rows.len() * field_px);
    let mut sheet = Sheet {
        width,
        height,
        color: vec![PAPER; width * height],
        depth: vec![f32::MAX; width * height],
    };
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for (row, fittings) in rows.iter().enumerate() {
        for (column, fitting) in fittings.iter().enumerate() {
            let archetype = atlas.archetype(fitting.model);
            counts.insert(archetype.key.clone(), archetype.levels[level].triangle_count());
            let [sx, sy, sz] = fitting.scale;
            let lies = archetype.key.contains("downed");
            let wide_m = if lies { sx + sy } else { 2.1 * sx };
            // stumps are not blown up to the size of trees
            let is_bare = archetype.key.contains(".bare.");
            let high_m = match (lies, is_bare) {
                (true, _) => 4.0 * sz,
                (false, true) => (1.05 * sz).max(6.0 * sx),
                (false, false) => 1.05 * sz + 0.3 * sx,
            };
            let field = Field {
                left: (column * field_px) as f32,
                bottom: ((row + 1) * field_px) as f32
                    - if lies { 0.4 } else { 0.06 } * field_px as f32,
                px_per_m: 0.9 * field_px as f32 / wide_m.max(high_m),
                middle_m: if lies { 0.5 * sx } else { 0.0 },
            };
            sheet.draw(&archetype, level, fitting.scale, &field, field_px as f32);
        }
    }
    for (key, count) in counts {
        println!("{count:5} {key}");
    }
    sheet.image().save(path)?;
    Ok(())
}

/// What a row shows: live forms from small to grown, snags by decay class, downed logs.
fn fittings(atlas: &LowPolyAtlas<'_>, index: u16, species: &Species) -> Vec<Fitting> {
    let plant = |height_m: f32, crowding_fraction: f32, variety: u32| {
        let radius_m = species.crown_radius_in_shade_m(height_m, crowding_fraction);
        atlas.plant(&PlantMeasures {
            species: index,
            height_m,
            crown_radius_m: radius_m,
            dbh_m: species.dbh_in_shade_m(height_m, crowding_fraction),
            crowding_fraction,
            variety,
        })
    };
    let grown_m = (0.62 * species.max_height_m).min(45.0);
    let mut all = vec![plant(1.2_f32.min(0.8 * species.max_height_m), 0.5, 0)];
    if species.form == Form::Herb {
        all.extend([plant(grown_m, 0.5, 1), plant(grown_m, 0.5, 2)]);
        return all;
    }
    all.push(plant(0.3 * grown_m, 1.0, 1));
    for variety in 0..2 {
        all.push(plant(grown_m, 1.0, variety));
        all.push(plant(grown_m, 0.0, variety));
    }
    let snag = |decay_class: u8, standing: f32, branch_fraction: f32| {
        atlas.snag(&SnagMeasures {
            species: index,
            height_m: standing * grown_m,
            height_at_death_m: grown_m,
            dbh_m: species.dbh_m(grown_m),
            decay_class,
            branch_fraction,
            variety: u32::from(decay_class),
        })
    };
    all.extend([snag(1, 1.0, 1.0), snag(2, 1.0, 0.7), snag(2, 0.6, 0.6), snag(3, 0.8, 0.4)]);
    all.extend([snag(4, 0.5, 0.0), snag(5, 0.04, 0.0)]);
    let log = |kind: DownedLogKind, decay_class: u8| {
        let diameter_base_m = 1.1 * species.dbh_m(grown_m);
        atlas.downed_log(&DownedLogMeasures {
            species: index,
            kind,
            length_m: 7.0 * diameter_base_m,
            diameter_base_m,
            diameter_tip_m: 0.7 * diameter_base_m,
            decay_class,
            variety: u32::from(decay_class),
        })
    };
    use DownedLogKind::{Branch, Top, Trunk, Uprooted};
    all.extend([log(Top, 1), log(Branch, 1), log(Trunk, 2), log(Trunk, 3)]);
    all.extend([log(Trunk, 4), log(Trunk, 5), log(Uprooted, 1), log(Uprooted, 3)]);
    all
}

impl Sheet {
    fn draw(
        &mut self,
        archetype: &Archetype,
        level: usize,
        scale: [f32; 3],
        field: &Field,
        field_px: f32,
    ) {
        let (tilt_sin, tilt_cos) = (libm::sinf(VIEW_RAD), libm::cosf(VIEW_RAD));
        // turned a little, so that root plates and ends are seen
        let lies = archetype.key.contains("downed");
        let turn = if lies { 0.5 } else { 0.3_f32 };
        let (turn_sin, turn_cos) = (libm::sinf(turn), libm::cosf(turn));
        let turned = |p: [f32; 3]| {
            [turn_cos * p[0] - turn_sin * p[1], turn_sin * p[0] + turn_cos * p[1], p[2]]
        };
        for part in &archetype.levels[level].parts {
            let color = archetype.color_srgb(part.material).map(f32::from);
            let seen: Vec<[f32; 3]> = part
                .positions
                .iter()
                .map(|p| {
                    let mut p: [f32; 3] = std::array::from_fn(|k| p[k] * scale[k]);
                    p[0] -= field.middle_m;
                    // what is below the ground is not seen
                    p[2] = if lies { p[2] } else { p[2].max(0.0) };
                    let [x, y, z] = turned(p);
                    let up = z * tilt_cos + y * tilt_sin;
                    [
                        field.left + 0.5 * field_px + x * field.px_per_m,
                        field.bottom - up * field.px_per_m,
                        y * tilt_cos - z * tilt_sin,
                    ]
                })
                .collect();
            let light: Vec<f32> = part
                .normals
                .iter()
                .map(|n| {
                    let n: [f32; 3] = std::array::from_fn(|k| n[k] / scale[k]);
                    let n = turned(n);
                    let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
                    let facing = (n[0] * LAMP[0] + n[1] * LAMP[1] + n[2] * LAMP[2]) / length;
                    let sky = 0.5 + 0.5 * n[2] / length;
                    0.28 + 0.38 * sky + 0.62 * facing.max(0.0)
                })
                .collect();
            for corners in &part.triangles {
                let at = corners.map(|c| c as usize);
                self.fill(at.map(|i| seen[i]), at.map(|i| light[i]), color);
            }
        }
    }

    /// Fills a triangle that faces the viewer.
    fn fill(&mut self, corners: [[f32; 3]; 3], light: [f32; 3], color: [f32; 3]) {
        let [a, b, c] = corners;
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        // rows count downwards: what winds counter-clockwise has a negative area
        if area >= 0.0 {
            return;
        }
        let range = |k: usize, most: usize| {
            let (low, high) = (a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k]));
            (low.max(0.0) as usize)..((high.max(0.0) as usize + 1).min(most))
        };
        for row in range(1, self.height) {
            for col in range(0, self.width) {
                let (x, y) = (col as f32 + 0.5, row as f32 + 0.5);
                let weight = |p: [f32; 3], q: [f32; 3]| {
                    ((q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])) / area
                };
                let weights = [weight(b, c), weight(c, a), weight(a, b)];
                if weights.iter().any(|w| *w < 0.0) {
                    continue;
                }
                let mix = |values: [f32; 3]| -> f32 {
                    weights.iter().zip(values).map(|(w, v)| w * v).sum()
                };
                let depth = mix([a[2], b[2], c[2]]);
                let index = row * self.width + col;
                if depth < self.depth[index] {
                    self.depth[index] = depth;
                    let lit = mix(light);
                    self.color[index] = color.map(|v| (v * lit).min(255.0));
                }
            }
        }
    }

    fn image(&self) -> RgbImage {
        let n = OVERSAMPLING as usize;
        let size = [self.width / n, self.height / n].map(|v| v as u32);
        RgbImage::from_fn(size[0], size[1], |x, y| {
            let mut sum = [0.0; 3];
            for row in 0..n {
                for col in 0..n {
                    let at = (y as usize * n + row) * self.width + x as usize * n + col;
                    (0..3).for_each(|k| sum[k] += self.color[at][k]);
                }
            }
            Rgb(sum.map(|v: f32| (v / (n * n) as f32).round() as u8))
        })
    }
}
