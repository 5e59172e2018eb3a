// Models and their leaves. Twin of src/export/render/picture.rs (draw_items) and foliage.rs, which define the result; same
// names, same steps. A leaf is worked out for each of its corners: cards have the time.

const MOST_LEAVES: f32 = 6000.0;
const LUMP_TILT: f32 = 2.1;
const INSIDE_OPENNESS: u32 = 110u;

const OUTLINE = array<vec2<f32>, 6>(
    vec2<f32>(-1.0, 0.0), vec2<f32>(-0.35, 1.0), vec2<f32>(0.35, 0.72),
    vec2<f32>(1.0, 0.0), vec2<f32>(0.35, -0.72), vec2<f32>(-0.35, -1.0),
);
// Which of them a kite has.
const KITE = array<u32, 4>(0u, 1u, 3u, 5u);

// A corner of bark, wood or soil.
@vertex
fn part(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    let item = items[call.first_item + instance];
    let triangle = triangles[call.first_triangle + vertex / 3u];
    let corner = corners[triangle.corners[vertex % 3u]];
    let place = item_place(item, corner.position);
    let ink = ink_of(triangle.number_and_surface & 15u, 128u, 255u);
    return Corner(clip(view_of(place)), item_normal(item, corner.normal), item.place, ink, place.xy);
}

struct Surface {
    a: vec3<f32>,
    b: vec3<f32>,
    c: vec3<f32>,
    normal_a: vec3<f32>,
    normal_b: vec3<f32>,
    normal_c: vec3<f32>,
    word: u32,
    // Depth of the nearest corner.
    depth_m: f32,
}

fn inset_corner(item: Item, corner: ModelCorner, normal: vec3<f32>) -> vec3<f32> {
    return view_of(item_place(item, corner.position) - normal * item.inset_m);
}

// A triangle of foliage in view metres, set in.
fn surface_of(item: Item, triangle: Triangle) -> Surface {
    var s: Surface;
    let a = corners[triangle.corners[0]];
    let b = corners[triangle.corners[1]];
    let c = corners[triangle.corners[2]];
    s.normal_a = item_normal(item, a.normal);
    s.normal_b = item_normal(item, b.normal);
    s.normal_c = item_normal(item, c.normal);
    s.a = inset_corner(item, a, s.normal_a);
    s.b = inset_corner(item, b, s.normal_b);
    s.c = inset_corner(item, c, s.normal_c);
    s.word = hash2(item.seed, triangle.number_and_surface >> 4u);
    s.depth_m = min(min(s.a.z, s.b.z), s.c.z);
    return s;
}

// A corner of a crown's inside.
@vertex
fn inside(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    let item = items[call.first_item + instance];
    let s = surface_of(item, triangles[call.first_triangle + vertex / 3u]);
    // leaves that touch the lens hide the forest
    if view.is_perspective != 0u && s.depth_m < 0.25 {
        return nowhere();
    }
    var v = s.a;
    var normal = s.normal_a;
    if vertex % 3u == 1u {
        v = s.b;
        normal = s.normal_b;
    } else if vertex % 3u == 2u {
        v = s.c;
        normal = s.normal_c;
    }
    let ink = ink_of(FOLIAGE, s.word >> 24u, select(255u, INSIDE_OPENNESS, item.is_leafy != 0u));
    return Corner(clip(v), normal, item.place, ink, vec2<f32>(0.0));
}

// A corner of a leaf; calls have four corners a leaf, or six of a rounded one.
@vertex
fn leaf(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    let is_near = view.is_perspective != 0u;
    let item = items[call.first_item + instance];
    let number = vertex / call.corners;
    let s = surface_of(item, triangles[call.first_triangle + number / call.leaves]);
    if is_near && s.depth_m < 0.25 {
        return nowhere();
    }
    let ab = s.b - s.a;
    let ac = s.c - s.a;
    let area_m2 = 0.5 * length(cross(ab, ac));
    let expected = item.cover * area_m2 / (0.5 * item.leaf_m * item.leaf_m * max(item.width, 0.34));
    let count = u32(min(expected, MOST_LEAVES) + unit(s.word));
    let k = number % call.leaves;
    if k >= count {
        return nowhere();
    }
    let rstu = four(hash2(s.word, k));
    let t = rstu.z;
    let u = rstu.w;
    let wbc = select(rstu.xy, 1.0 - rstu.xy, rstu.x + rstu.y > 1.0);
    let base = s.a + ab * wbc.x + ac * wbc.y;
    let slack_px = 1.0 + (2.0 * (item.fringe_m + item.leaf_m) + item.lump_reach_m) * px_per_m_at(s.depth_m);
    if !touches(pixel_of(base), slack_px) {
        return nowhere();
    }
    let normal = unit_or_up(s.normal_a + (s.normal_b - s.normal_a) * wbc.x + (s.normal_c - s.normal_a) * wbc.y);
    let noise_word = hash2(s.word ^ 0x5bd1u, k);
    let random = direction(noise_word);
    let outward = vec3<f32>(dot(normal, view.right), dot(normal, view.up), dot(normal, view.forward));
    let gravity = vec3<f32>(0.0, -view.up.z, -view.forward.z);
    // crowns are lumpy: boughs reach out, and dark is between them
    let lump_offset = vec3<f32>(f32(item.seed & 0xffu), f32((item.seed >> 8u) & 0xffu), 0.0);
    let lump_at = (place_of(base) - item.position) / item.lump_m + lump_offset;
    let lump_slope = smooth_with_slope(lump_at);
    let lump = lump_slope.x;
    let tilted = unit_or_up(normal - lump_slope.yzw * (item.lumpiness * LUMP_TILT));
    let lift_m = item.fringe_m * (0.6 + 1.6 * t - 0.6 * (1.0 - u) * t) + item.lump_reach_m * max(1.4 * lump - 0.35, 0.0);
    let middle = base + outward * lift_m;
    if is_near && middle.z < 0.3 {
        return nowhere();
    }
    let axis = unit_or_up(outward * 0.7 + random + gravity * item.droop) * (0.5 * item.leaf_m);
    let side = unit_or_up(cross(axis, outward * 0.4 + direction(noise_word ^ 0x9e37u))) * (0.5 * item.leaf_m * item.width);
    let leaf_normal = unit_or_up(cross(side, axis));
    let leaf_world = view.right * leaf_normal.x + view.up * leaf_normal.y + view.forward * leaf_normal.z;
    let facing = select(leaf_world, -leaf_world, dot(leaf_world, normal) < 0.0);
    let shading = unit_or_up(tilted * 0.66 + facing * 0.34);
    let depth_share = clamp(0.30 * t + 1.7 * (lump - 0.22), 0.0, 1.0);
    let ink = ink_of(FOLIAGE, (noise_word >> 16u) & 0xffu, u32(70.0 + 185.0 * depth_share));
    var outline = OUTLINE;
    var kite = KITE;
    let corner = vertex % call.corners;
    var at = corner;
    if call.corners == 4u {
        at = kite[corner];
    }
    let along_across = outline[at];
    let v = middle + axis * along_across.x + side * along_across.y;
    return Corner(clip(v), shading, item.place, ink, vec2<f32>(0.0));
}
