// Depth maps seen from the sun. Twin of src/export/render/shadow.rs (draw_item), which defines the result; same steps.

struct Cast {
    @builtin(position) position: vec4<f32>,
    // Where gaps are looked up, in their sizes.
    @location(0) gap_at: vec3<f32>,
}

// A corner of a model without gaps.
@vertex
fn cast_part(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    let item = items[call.first_item + instance];
    let triangle = triangles[call.first_triangle + vertex / 3u];
    return clip(view_of(item_place(item, corners[triangle.corners[vertex % 3u]].position)));
}

// A corner of foliage.
@vertex
fn cast_foliage(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Cast {
    let item = items[call.first_item + instance];
    let triangle = triangles[call.first_triangle + vertex / 3u];
    let place = item_place(item, corners[triangle.corners[vertex % 3u]].position);
    let offset = vec3<f32>(f32(item.seed & 0xffu), f32((item.seed >> 8u) & 0xffu), 0.0);
    return Cast(clip(view_of(place)), place / view.gap_m + offset);
}

@fragment
fn leave_gaps(at: Cast) {
    if smooth_noise(at.gap_at) < view.gap_threshold {
        discard;
    }
}
