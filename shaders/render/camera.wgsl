// Cameras: from places in metres to places on the picture. Twin of src/export/render/camera.rs; same names, same steps.

// A camera, the band of the picture that is drawn, and the ground under both.
struct View {
    eye: vec3<f32>,
    // Pixels a metre, or with perspective a unit of tangent.
    px_per_m: f32,
    right: vec3<f32>,
    // Depth buffers hold `depth_base + depth_scale · nearness`, within 0..1.
    depth_base: f32,
    up: vec3<f32>,
    depth_scale: f32,
    forward: vec3<f32>,
    // 1 where rays run through the eye, else 0.
    is_perspective: u32,
    // Width and height of the whole picture.
    size_px: vec2<f32>,
    // Left and upper edge of the band.
    window_px: vec2<f32>,
    // Width and height of the band.
    window_size_px: vec2<f32>,
    // Size of gaps in foliage that the sun shines through.
    gap_m: f32,
    // Least smooth noise that is no gap.
    gap_threshold: f32,
    // West, north, south and east edge of the ground.
    edges_m: vec4<f32>,
    // Corners of ground a row, and rows.
    ground_cols: u32,
    ground_rows: u32,
    ground_cell_m: f32,
    // The lower end of walls.
    base_m: f32,
    // Whether the ground ends with walls.
    has_walls: u32,
    // Whether a cell of ground that lacks one corner is left out.
    needs_all_corners: u32,
    pad_a: u32,
    pad_b: u32,
}

// Nothing nearer than this is drawn.
const NEAR_M: f32 = 0.08;
// Outside of any picture: triangles that come here are not drawn.
const NOWHERE: vec4<f32> = vec4<f32>(2.0, 2.0, 2.0, 1.0);

@group(0) @binding(0) var<uniform> view: View;

// Metres to the right, up and into the picture.
fn view_of(place: vec3<f32>) -> vec3<f32> {
    let d = place - view.eye;
    return vec3<f32>(dot(d, view.right), dot(d, view.up), dot(d, view.forward));
}

fn place_of(v: vec3<f32>) -> vec3<f32> {
    return view.eye + view.right * v.x + view.up * v.y + view.forward * v.z;
}

// Where a place in view metres lies in the band, and how near.
fn clip(v: vec3<f32>) -> vec4<f32> {
    let is_perspective = view.is_perspective != 0u;
    let w = select(1.0, v.z, is_perspective);
    let px = 0.5 * view.size_px * w + vec2<f32>(v.x, -v.y) * view.px_per_m;
    let at = (px - view.window_px * w) * (2.0 / view.window_size_px) - w;
    let z = view.depth_base * w + view.depth_scale * select(-v.z, 1.0, is_perspective);
    return vec4<f32>(at.x, -at.y, z, w);
}

// Where the middle of a pixel of the picture lies in the band.
fn clip_pixel(pixel: vec2<f32>, nearness: f32) -> vec4<f32> {
    let at = (pixel + 0.5 - view.window_px) * (2.0 / view.window_size_px) - 1.0;
    return vec4<f32>(at.x, -at.y, view.depth_base + view.depth_scale * nearness, 1.0);
}

fn px_per_m_at(depth_m: f32) -> f32 {
    return view.px_per_m / select(1.0, max(depth_m, NEAR_M), view.is_perspective != 0u);
}

// Pixels of the whole picture from its upper left corner.
fn pixel_of(v: vec3<f32>) -> vec2<f32> {
    let scale = view.px_per_m / select(1.0, v.z, view.is_perspective != 0u);
    return 0.5 * view.size_px + vec2<f32>(v.x, -v.y) * scale;
}

// Whether a square around a pixel touches the band.
fn touches(pixel: vec2<f32>, reach_px: f32) -> bool {
    let from_window = pixel - view.window_px;
    return all(from_window + reach_px >= vec2<f32>(0.0)) && all(from_window - reach_px <= view.window_size_px);
}
