// What each sample shows: four words a sample. Twin of src/export/render/surface_buffer.rs.

// Surfaces; 0 is sky.
const GROUND: u32 = 1u;
const WALL: u32 = 2u;
const GRASS: u32 = 3u;
const LITTER: u32 = 4u;
const FOLIAGE: u32 = 6u;

struct Corner {
    @builtin(position) position: vec4<f32>,
    // Straight over the picture, as the CPU has it.
    @location(0) @interpolate(linear) normal: vec3<f32>,
    @location(1) @interpolate(flat) item: u32,
    // Surface, variation and openness, a byte each.
    @location(2) @interpolate(flat) ink: u32,
    // East and north.
    @location(3) place: vec2<f32>,
}

fn ink_of(surface: u32, variation: u32, openness: u32) -> u32 {
    return surface | (variation << 8u) | (openness << 16u);
}

fn nowhere() -> Corner {
    return Corner(NOWHERE, UP, 0u, 0u, vec2<f32>(0.0));
}

// A direction in two halves of a word: the octahedron's eight faces folded onto a square.
fn packed_normal(v: vec3<f32>) -> u32 {
    let n = unit_or_up(v);
    let flat_n = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
    let folded = (1.0 - abs(flat_n.yx)) * select(vec2<f32>(-1.0), vec2<f32>(1.0), flat_n >= vec2<f32>(0.0));
    return pack2x16snorm(select(folded, flat_n, n.z >= 0.0));
}

fn sample_of(corner: Corner) -> vec4<u32> {
    let nearness = (corner.position.z - view.depth_base) / view.depth_scale;
    return vec4<u32>(corner.item, corner.ink, packed_normal(corner.normal), bitcast<u32>(nearness));
}

@fragment
fn show(corner: Corner) -> @location(0) vec4<u32> {
    return sample_of(corner);
}

// What is cut where the ground ends.
@fragment
fn show_cut(corner: Corner) -> @location(0) vec4<u32> {
    let p = corner.place;
    if p.x < view.edges_m.x || p.y > view.edges_m.y || p.y < view.edges_m.z || p.x > view.edges_m.w {
        discard;
    }
    return sample_of(corner);
}
