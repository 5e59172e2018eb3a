// Noise that breaks surfaces up. Twin of src/export/render/noise.rs, which defines the result; same names, same steps.

const UP: vec3<f32> = vec3<f32>(0.0, 0.0, 1.0);
const TAU: f32 = 6.2831853071795864769;

// A vector at length 1, up where it has none.
fn unit_or_up(v: vec3<f32>) -> vec3<f32> {
    let square = dot(v, v);
    return select(UP, v / sqrt(max(square, 1e-37)), square > 1e-37);
}

fn hash(word: u32) -> u32 {
    let state = word * 747796405u + 2891336453u;
    let mixed = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (mixed >> 22u) ^ mixed;
}

fn hash2(a: u32, b: u32) -> u32 {
    return hash(a ^ hash(b));
}

fn unit(word: u32) -> f32 {
    return f32(word >> 8u) * (1.0 / 16777216.0);
}

fn four(word: u32) -> vec4<f32> {
    let second = hash(word);
    return vec4<f32>(vec4<u32>(word & 0xffffu, word >> 16u, second & 0xffffu, second >> 16u)) * (1.0 / 65536.0);
}

fn direction(word: u32) -> vec3<f32> {
    let r = four(word).xyz;
    return unit_or_up(r + r - 1.0);
}

fn lattice(x: i32, y: i32, z: i32) -> f32 {
    return unit(hash((bitcast<u32>(x) * 0x8da6b343u) ^ (bitcast<u32>(y) * 0xd8163841u) ^ (bitcast<u32>(z) * 0xcb1ab31fu)));
}

fn smooth_noise(p: vec3<f32>) -> f32 {
    let low = floor(p);
    let c = vec3<i32>(low);
    let f = p - low;
    let t = f * f * (3.0 - 2.0 * f);
    let south_low = mix(lattice(c.x, c.y, c.z), lattice(c.x + 1, c.y, c.z), t.x);
    let north_low = mix(lattice(c.x, c.y + 1, c.z), lattice(c.x + 1, c.y + 1, c.z), t.x);
    let south_high = mix(lattice(c.x, c.y, c.z + 1), lattice(c.x + 1, c.y, c.z + 1), t.x);
    let north_high = mix(lattice(c.x, c.y + 1, c.z + 1), lattice(c.x + 1, c.y + 1, c.z + 1), t.x);
    return mix(mix(south_low, north_low, t.y), mix(south_high, north_high, t.y), t.z);
}

// Smooth noise (x) and how it rises along each axis (yzw).
fn smooth_with_slope(p: vec3<f32>) -> vec4<f32> {
    let low = floor(p);
    let k = vec3<i32>(low);
    let t = p - low;
    let e = t * t * (3.0 - 2.0 * t);
    let rate = 6.0 * t * (1.0 - t);
    let a = lattice(k.x, k.y, k.z);
    let b = lattice(k.x + 1, k.y, k.z);
    let c = lattice(k.x, k.y + 1, k.z);
    let d = lattice(k.x + 1, k.y + 1, k.z);
    let ee = lattice(k.x, k.y, k.z + 1);
    let f = lattice(k.x + 1, k.y, k.z + 1);
    let g = lattice(k.x, k.y + 1, k.z + 1);
    let h = lattice(k.x + 1, k.y + 1, k.z + 1);
    let ab = mix(a, b, e.x);
    let cd = mix(c, d, e.x);
    let ef = mix(ee, f, e.x);
    let gh = mix(g, h, e.x);
    let below = mix(ab, cd, e.y);
    let above = mix(ef, gh, e.y);
    let slope = vec3<f32>(
        mix(mix(b - a, d - c, e.y), mix(f - ee, h - g, e.y), e.z),
        mix(cd - ab, gh - ef, e.z),
        above - below,
    );
    return vec4<f32>(mix(below, above, e.z), slope * rate);
}

fn smooth_level(x: f32, y: f32, layer: i32) -> f32 {
    let p = vec2<f32>(x, y);
    let low = floor(p);
    let c = vec2<i32>(low);
    let f = p - low;
    let t = f * f * (3.0 - 2.0 * f);
    let south = mix(lattice(c.x, c.y, layer), lattice(c.x + 1, c.y, layer), t.x);
    let north = mix(lattice(c.x, c.y + 1, layer), lattice(c.x + 1, c.y + 1, layer), t.x);
    return mix(south, north, t.y);
}
