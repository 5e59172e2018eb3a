// The terrain as triangles. Twin of src/export/render/ground_mesh.rs, which defines the result; same names, same steps.

const PATCH_CELLS: u32 = 32u;

struct Patch {
    row: u32,
    col: u32,
    // Cells a side of its triangles.
    step: u32,
    pad: u32,
}

struct Call {
    first_patch: u32,
    // Triangles' squares a side of a patch.
    squares: u32,
    pad_a: u32,
    pad_b: u32,
}

@group(0) @binding(2) var<storage, read> patches: array<Patch>;
@group(1) @binding(0) var<uniform> call: Call;

// The stop number `i` of a row or column of corners that begins at `first`.
fn stop(first: u32, end: u32, step: u32, i: u32) -> u32 {
    return min(first + i * step, min(first + PATCH_CELLS, end));
}

fn ground_ink(surface: u32) -> u32 {
    return ink_of(surface, 128u, 255u);
}

@vertex
fn ground(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    let square = patches[call.first_patch + instance];
    let i = (vertex / 6u) % call.squares;
    let j = (vertex / 6u) / call.squares;
    let west = stop(square.col, view.ground_cols - 1u, square.step, i);
    let east = stop(square.col, view.ground_cols - 1u, square.step, i + 1u);
    let north = stop(square.row, view.ground_rows - 1u, square.step, j);
    let south = stop(square.row, view.ground_rows - 1u, square.step, j + 1u);
    if west == east || north == south {
        return nowhere();
    }
    let a = ground_corner(north, west);
    let b = ground_corner(north, east);
    let c = ground_corner(south, east);
    let d = ground_corner(south, west);
    // the triangles a d c and a c b
    let is_second = vertex % 6u >= 3u;
    let other = select(d.z, b.z, is_second);
    let lowest = min(min(a.z, c.z), select(other, min(b.z, d.z), view.needs_all_corners != 0u));
    if lowest < NO_GROUND_M {
        return nowhere();
    }
    var place = a;
    switch vertex % 6u {
        case 1u: { place = d; }
        case 2u, 4u: { place = c; }
        case 5u: { place = b; }
        default: {}
    }
    return Corner(clip(view_of(place)), UP, 0u, ground_ink(GROUND), place.xy);
}

// What hides gaps between patches of different steps, or the terrain's end.
@vertex
fn skirt(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    let square = patches[call.first_patch + instance];
    let last_row = min(square.row + PATCH_CELLS, view.ground_rows - 1u);
    let last_col = min(square.col + PATCH_CELLS, view.ground_cols - 1u);
    let i = (vertex / 6u) % call.squares;
    let side = (vertex / 6u) / call.squares;
    let is_row = side < 2u;
    var line = square.row;
    var is_rim = square.row == 0u;
    var outward = vec3<f32>(0.0, 1.0, 0.0);
    if side == 1u {
        line = last_row;
        is_rim = last_row == view.ground_rows - 1u;
        outward = vec3<f32>(0.0, -1.0, 0.0);
    } else if side == 2u {
        line = square.col;
        is_rim = square.col == 0u;
        outward = vec3<f32>(-1.0, 0.0, 0.0);
    } else if side == 3u {
        line = last_col;
        is_rim = last_col == view.ground_cols - 1u;
        outward = vec3<f32>(1.0, 0.0, 0.0);
    }
    let first = select(square.row, square.col, is_row);
    let end = select(view.ground_rows - 1u, view.ground_cols - 1u, is_row);
    let from_stop = stop(first, end, square.step, i);
    let to_stop = stop(first, end, square.step, i + 1u);
    if from_stop == to_stop {
        return nowhere();
    }
    let a = ground_corner(select(from_stop, line, is_row), select(line, from_stop, is_row));
    let b = ground_corner(select(to_stop, line, is_row), select(line, to_stop, is_row));
    if min(a.z, b.z) < NO_GROUND_M {
        return nowhere();
    }
    let is_wall = is_rim && view.has_walls != 0u;
    let drop_m = f32(square.step) * view.ground_cell_m;
    let lower_a = vec3<f32>(a.xy, select(a.z - drop_m, view.base_m, is_wall));
    let lower_b = vec3<f32>(b.xy, select(b.z - drop_m, view.base_m, is_wall));
    // the triangles a b B and a B A
    var place = a;
    switch vertex % 6u {
        case 1u: { place = b; }
        case 2u, 4u: { place = lower_b; }
        case 5u: { place = lower_a; }
        default: {}
    }
    return Corner(clip(view_of(place)), outward, 0u, ground_ink(select(GROUND, WALL, is_wall)), place.xy);
}
