// Heights of the terrain's corners. Twin of src/export/render/ground.rs.

// Heights below this stand for no ground.
const NO_GROUND_M: f32 = -1e30;

@group(0) @binding(1) var<storage, read> heights: array<f32>;

fn ground_corner(row: u32, col: u32) -> vec3<f32> {
    return vec3<f32>(
        view.edges_m.x + f32(col) * view.ground_cell_m,
        view.edges_m.y - f32(row) * view.ground_cell_m,
        heights[row * view.ground_cols + col],
    );
}

// Height at a place, below NO_GROUND_M where there is none.
fn ground_height(x: f32, y: f32) -> f32 {
    let col = clamp((x - view.edges_m.x) / view.ground_cell_m, 0.0, f32(view.ground_cols - 1u));
    let row = clamp((view.edges_m.y - y) / view.ground_cell_m, 0.0, f32(view.ground_rows - 1u));
    let c = min(u32(col), view.ground_cols - 2u);
    let r = min(u32(row), view.ground_rows - 2u);
    let tc = col - f32(c);
    let tr = row - f32(r);
    let first = r * view.ground_cols + c;
    let second = first + view.ground_cols;
    let a = heights[first];
    let b = heights[first + 1u];
    let d = heights[second];
    let e = heights[second + 1u];
    if min(min(a, b), min(d, e)) < NO_GROUND_M {
        return 2.0 * NO_GROUND_M;
    }
    let north = a + (b - a) * tc;
    let south = d + (e - d) * tc;
    return north + (south - north) * tr;
}
