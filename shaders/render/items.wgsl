// Items: models where they stand, as the calls of a pipeline find them. Twin of src/export/render/draw_list.rs.

struct Item {
    position: vec3<f32>,
    // Its place in the list of all.
    place: u32,
    // Where the model's axes point, as long as they are stretched.
    axis_x: vec3<f32>,
    // Group and index, hashed.
    seed: u32,
    axis_y: vec3<f32>,
    leaf_m: f32,
    axis_z: vec3<f32>,
    fringe_m: f32,
    lump_m: f32,
    lump_reach_m: f32,
    inset_m: f32,
    // Leaves' areas over the surface's.
    cover: f32,
    // A leaf's width over its length.
    width: f32,
    droop: f32,
    lumpiness: f32,
    is_leafy: u32,
}

struct ModelCorner {
    position: vec3<f32>,
    pad_a: u32,
    normal: vec3<f32>,
    pad_b: u32,
}

struct Triangle {
    corners: array<u32, 3>,
    // Its number within its part, and the part's surface in the lowest four bits.
    number_and_surface: u32,
}

struct Call {
    first_item: u32,
    first_triangle: u32,
    // Most leaves on a triangle.
    leaves: u32,
    // Corners of a leaf.
    corners: u32,
}

@group(0) @binding(1) var<storage, read> items: array<Item>;
@group(0) @binding(2) var<storage, read> corners: array<ModelCorner>;
@group(0) @binding(3) var<storage, read> triangles: array<Triangle>;
@group(1) @binding(0) var<uniform> call: Call;

fn item_place(item: Item, p: vec3<f32>) -> vec3<f32> {
    return item.position + item.axis_x * p.x + item.axis_y * p.y + item.axis_z * p.z;
}

fn item_normal(item: Item, n: vec3<f32>) -> vec3<f32> {
    let i = item.axis_x / max(dot(item.axis_x, item.axis_x), 1e-12);
    let j = item.axis_y / max(dot(item.axis_y, item.axis_y), 1e-12);
    let k = item.axis_z / max(dot(item.axis_z, item.axis_z), 1e-12);
    return unit_or_up(i * n.x + j * n.y + k * n.z);
}
