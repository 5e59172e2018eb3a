// Grass and litter near the eye. Twin of src/export/render/strew.rs, which defines the result; same names, same steps.

struct Tuft {
    col: i32,
    row: i32,
    px_per_m: f32,
    // Blades in the lower half of the word, fallen leaves in the upper.
    counts: u32,
}

struct Call {
    first_tuft: u32,
    pad: u32,
    // Columns and rows of the map, its cells, its western and northern edge.
    cols: u32,
    rows: u32,
    cell_m: f32,
    west_m: f32,
    north_m: f32,
}

@group(0) @binding(2) var<storage, read> field: array<f32>;
@group(0) @binding(3) var<storage, read> tufts: array<Tuft>;
@group(1) @binding(0) var<uniform> call: Call;

fn field_at(x: f32, y: f32) -> f32 {
    let col = clamp((x - call.west_m) / call.cell_m - 0.5, 0.0, f32(call.cols - 1u));
    let row = clamp((call.north_m - y) / call.cell_m - 0.5, 0.0, f32(call.rows - 1u));
    let c0 = u32(col);
    let r0 = u32(row);
    let c1 = min(c0 + 1u, call.cols - 1u);
    let r1 = min(r0 + 1u, call.rows - 1u);
    let t = vec2<f32>(col - f32(c0), row - f32(r0));
    let north = mix(field[r0 * call.cols + c0], field[r0 * call.cols + c1], t.x);
    let south = mix(field[r1 * call.cols + c0], field[r1 * call.cols + c1], t.x);
    return mix(north, south, t.y);
}

// A place on a square of ground; its height is below NO_GROUND_M where there is none.
fn tuft_place(tuft: Tuft, uv: vec2<f32>) -> vec3<f32> {
    let x = f32(tuft.col) + uv.x;
    let y = f32(tuft.row) + uv.y;
    return vec3<f32>(x, y, ground_height(x, y));
}

// Whether what stands at a place and reaches as far as that is outside the band.
fn is_outside(place: vec3<f32>, reach_m: f32) -> bool {
    let v = view_of(place);
    if place.z < NO_GROUND_M || v.z < 0.3 {
        return true;
    }
    return !touches(pixel_of(v), reach_m * px_per_m_at(v.z) * 1.2 + 2.0);
}

fn eased(t: f32) -> f32 {
    let x = clamp(t, 0.0, 1.0);
    return x * x * (3.0 - 2.0 * x);
}

@vertex
fn grass(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    let tuft = tufts[call.first_tuft + instance];
    let k = vertex / 9u;
    if k >= (tuft.counts & 0xffffu) {
        return nowhere();
    }
    let word = hash2(bitcast<u32>(tuft.col), bitcast<u32>(tuft.row));
    // far blades are fewer and wider
    let width_m = max(1.3 / tuft.px_per_m, 0.0055);
    let uvst = four(hash2(word, k));
    let s = uvst.z;
    let root = tuft_place(tuft, uvst.xy);
    if is_outside(root, 0.7) {
        return nowhere();
    }
    let sward_m = field_at(root.x, root.y);
    // grass grows in tufts
    let clump = smooth_level(root.x / 0.55, root.y / 0.55, 31);
    let chance = min(sward_m / 0.14, 1.0) * eased((clump - 0.22) * 2.2);
    if s > chance {
        return nowhere();
    }
    let height_m = clamp(sward_m * (0.55 + 0.75 * uvst.w) * (0.6 + 0.8 * clump), 0.02, 0.7);
    if height_m * tuft.px_per_m < 1.5 {
        return nowhere();
    }
    let angle = unit(hash2(word ^ 0x77u, k)) * TAU;
    let lean = vec3<f32>(cos(angle), sin(angle), 0.0);
    let side = view.right * (0.5 * width_m);
    let bend = 0.25 + 0.5 * (s / max(chance, 1e-3));
    let middle = root + UP * (0.6 * height_m) + lean * (0.18 * bend * height_m);
    let tip = root + UP * (height_m * (1.0 - 0.25 * bend)) + lean * (0.62 * bend * height_m);
    let normal = unit_or_up(lean * -0.6 + UP);
    let variation = u32(unit(hash2(word ^ 0x99u, k)) * 255.0);
    let low_0 = view_of(root - side);
    let low_1 = view_of(root + side);
    let low_2 = view_of(middle + side * 0.8);
    let low_3 = view_of(middle - side * 0.8);
    if min(min(low_0.z, low_1.z), min(low_2.z, low_3.z)) < NEAR_M * 3.0 {
        return nowhere();
    }
    let corner = vertex % 9u;
    var v = low_0;
    switch corner {
        case 1u: { v = low_1; }
        case 2u, 4u, 7u: { v = low_2; }
        case 5u, 6u: { v = low_3; }
        case 8u: { v = view_of(tip); }
        default: {}
    }
    let ink = ink_of(GRASS, variation, select(150u, 245u, corner >= 6u));
    return Corner(clip(v), normal, 0u, ink, vec2<f32>(0.0));
}

@vertex
fn litter(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    let tuft = tufts[call.first_tuft + instance];
    let k = vertex / 6u;
    if k >= (tuft.counts >> 16u) {
        return nowhere();
    }
    let word = hash2(bitcast<u32>(tuft.col), bitcast<u32>(tuft.row)) ^ 0x12345678u;
    let length_m = max(2.0 / tuft.px_per_m, 0.055);
    let uvst = four(hash2(word, k));
    let s = uvst.z;
    let ground = tuft_place(tuft, uvst.xy);
    if is_outside(ground, length_m) || s > field_at(ground.x, ground.y) * 1.25 {
        return nowhere();
    }
    let random = direction(hash2(word ^ 0x51u, k));
    let normal = unit_or_up(random * 0.45 + UP);
    let angle = uvst.w * TAU;
    let across = unit_or_up(cross(normal, vec3<f32>(cos(angle), sin(angle), 0.0)));
    let long = cross(across, normal) * (0.5 * length_m);
    let wide = across * (0.26 * length_m);
    let middle = ground + UP * (0.012 + 0.02 * s);
    let ab = four(hash2(word ^ 0x99u, k));
    let p = view_of(middle - long);
    let q = view_of(middle + wide);
    let r = view_of(middle + long);
    let t = view_of(middle - wide);
    if min(min(p.z, q.z), min(r.z, t.z)) < NEAR_M * 3.0 {
        return nowhere();
    }
    var v = p;
    switch vertex % 6u {
        case 1u: { v = q; }
        case 2u, 4u: { v = r; }
        case 5u: { v = t; }
        default: {}
    }
    let ink = ink_of(LITTER, u32(ab.x * 255.0), u32(120.0 + 130.0 * ab.y));
    return Corner(clip(v), normal, 0u, ink, vec2<f32>(0.0));
}
