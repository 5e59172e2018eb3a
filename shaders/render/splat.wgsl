// Splats: what is smaller than triangles are worth. Twin of src/export/render/picture.rs (splat).

struct Splat {
    // Its middle on the picture.
    middle_px: vec2<f32>,
    // Width and height.
    size_px: vec2<f32>,
    nearness: f32,
    // Pixels it covers on average.
    area_px: f32,
    place: u32,
    word: u32,
}

struct Call {
    first_splat: u32,
    pad_a: u32,
    pad_b: u32,
    pad_c: u32,
}

@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(1) @binding(0) var<uniform> call: Call;

@vertex
fn splat(@builtin(vertex_index) k: u32, @builtin(instance_index) instance: u32) -> Corner {
    let s = splats[call.first_splat + instance];
    let abcd = four(hash2(s.word, k));
    // dot k is drawn if so much is left behind those before it
    if s.area_px - f32(k) < abcd.x {
        return nowhere();
    }
    let pixel = floor(s.middle_px + (abcd.yz - 0.5) * s.size_px);
    let normal = unit_or_up(direction(hash2(s.word, k ^ 0x33u)) * 0.7 + UP);
    let ink = ink_of(FOLIAGE, u32(abcd.w * 255.0), 215u);
    return Corner(clip_pixel(pixel, s.nearness), normal, s.place, ink, vec2<f32>(0.0));
}

// A splat of a depth map: one pixel.
@vertex
fn cast_splat(@builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    let s = splats[call.first_splat + instance];
    return clip_pixel(s.middle_px, s.nearness);
}
