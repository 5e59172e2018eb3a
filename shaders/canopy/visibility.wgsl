// Visibility: which crown the sky sees at each working cell, and how much of each crown it sees.
//
// Twin of src/canopy/visibility.rs, which defines the result; driven by src/canopy/visibility_gpu.rs. Whole numbers only,
// in units of 1/32 of a cell, so that both give the same bits. A workgroup works on one crown: its lanes walk the cells
// around the trunk in tiles of 8 × 8. The grid is worked in bands of rows; rows and columns here are the whole grid's.

// Units in the width of a cell, as a power of two: shifts round down below zero too, divisions would not.
const CELL_SHIFT: u32 = 5u;
const HALF_CELL: i32 = 16;
// Lanes of a workgroup along a side of its tile.
const SIDE: u32 = 8u;

struct Band {
    // First row of the band.
    first_row: u32,
    // Rows of the band.
    rows: u32,
    // Columns of the grid.
    cols: u32,
    // Number of crowns.
    crowns: u32,
}

struct Crown {
    // From the grid's west edge eastward to the trunk.
    x: i32,
    // From the grid's north edge southward to the trunk.
    y: i32,
    // Radius of the sphere.
    radius: i32,
    // Elevation of the sphere's centre, below 0 too.
    center_z: i32,
}

struct Tally {
    // Cells seen of the crown.
    visible_cells: u32,
    // Those that are canopy.
    canopy_cells: u32,
    // Sum over those of columns east of the trunk's cell.
    sum_cols: i32,
    // Sum over those of rows south of the trunk's cell.
    sum_rows: i32,
}

@group(0) @binding(0) var<uniform> band: Band;
@group(0) @binding(1) var<storage, read> crowns: array<Crown>;
// Height of the highest sphere at each cell of the band, as `depth_at` has it; 0, as cleared, where there is none.
@group(0) @binding(2) var<storage, read_write> depth: array<atomic<u32>>;
// Complement of the index of the crown seen at each cell of the band, so that the lowest index is the greatest number
// and 0, as cleared, means no crown.
@group(0) @binding(3) var<storage, read_write> owner: array<atomic<u32>>;
// Whether a cell of the band is canopy: four cells a word, one a byte.
@group(0) @binding(4) var<storage, read> is_canopy: array<u32>;
@group(0) @binding(5) var<storage, read_write> tallies: array<Tally>;

// Cells within a crown's reach, in the band; first beyond last where there are none.
struct Reach {
    first_row: i32,
    last_row: i32,
    first_col: i32,
    last_col: i32,
}

fn reach_of(crown: Crown) -> Reach {
    let first_row = i32(band.first_row);
    var reach: Reach;
    // the first cell whose centre is no further than the radius, and the last
    let round_up = (1 << CELL_SHIFT) - 1;
    reach.first_row = max((crown.y - crown.radius - HALF_CELL + round_up) >> CELL_SHIFT, first_row);
    reach.last_row = min((crown.y + crown.radius - HALF_CELL) >> CELL_SHIFT, first_row + i32(band.rows) - 1);
    reach.first_col = max((crown.x - crown.radius - HALF_CELL + round_up) >> CELL_SHIFT, 0);
    reach.last_col = min((crown.x + crown.radius - HALF_CELL) >> CELL_SHIFT, i32(band.cols) - 1);
    return reach;
}

fn cell_of_band(row: i32, col: i32) -> u32 {
    return (u32(row) - band.first_row) * band.cols + u32(col);
}

// Whole root of 0 <= square < 2^22, rounded down. The hardware's root may be off in its last bits, the result is not.
fn whole_root(square: i32) -> i32 {
    var root = i32(sqrt(f32(square)));
    if root * root > square {
        root -= 1;
    }
    if (root + 1) * (root + 1) <= square {
        root += 1;
    }
    return root;
}

// Height of a crown's sphere over a cell's centre, with its sign bit turned so that it orders without sign: the lowest
// height of all, which no sphere has, becomes 0. 0 where the centre is not under the crown.
fn depth_at(crown: Crown, row: i32, col: i32) -> u32 {
    let dx = (col << CELL_SHIFT) + HALF_CELL - crown.x;
    let dy = (row << CELL_SHIFT) + HALF_CELL - crown.y;
    let left = crown.radius * crown.radius - (dx * dx + dy * dy);
    if left < 0 {
        return 0u;
    }
    return bitcast<u32>(crown.center_z + whole_root(left)) ^ 0x80000000u;
}

// Which crown a workgroup works on; workgroups are laid out in rows, and the last row may have some too many.
fn crown_of(workgroup: vec3<u32>, workgroups: vec3<u32>) -> u32 {
    return workgroup.y * workgroups.x + workgroup.x;
}

// Step 1: the height of the highest sphere at each cell.
@compute @workgroup_size(SIDE, SIDE)
fn raise_depth(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_id) lane: vec3<u32>,
) {
    let index = crown_of(workgroup, workgroups);
    if index >= band.crowns {
        return;
    }
    let crown = crowns[index];
    let reach = reach_of(crown);
    for (var row = reach.first_row + i32(lane.y); row <= reach.last_row; row += i32(SIDE)) {
        for (var col = reach.first_col + i32(lane.x); col <= reach.last_col; col += i32(SIDE)) {
            let here = depth_at(crown, row, col);
            if here > 0u {
                atomicMax(&depth[cell_of_band(row, col)], here);
            }
        }
    }
}

// Step 2: the crown that reaches this height; of several, the one with the lowest index.
@compute @workgroup_size(SIDE, SIDE)
fn claim_cells(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_id) lane: vec3<u32>,
) {
    let index = crown_of(workgroup, workgroups);
    if index >= band.crowns {
        return;
    }
    let crown = crowns[index];
    let reach = reach_of(crown);
    for (var row = reach.first_row + i32(lane.y); row <= reach.last_row; row += i32(SIDE)) {
        for (var col = reach.first_col + i32(lane.x); col <= reach.last_col; col += i32(SIDE)) {
            let here = depth_at(crown, row, col);
            let cell = cell_of_band(row, col);
            if here > 0u && here == atomicLoad(&depth[cell]) {
                atomicMax(&owner[cell], ~index);
            }
        }
    }
}

var<workgroup> visible_cells: atomic<u32>;
var<workgroup> canopy_cells: atomic<u32>;
var<workgroup> sum_cols: atomic<i32>;
var<workgroup> sum_rows: atomic<i32>;

// Step 3: what is seen of each crown. Bands add up, one after the other.
@compute @workgroup_size(SIDE, SIDE)
fn tally_crowns(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_id) lane: vec3<u32>,
) {
    let index = crown_of(workgroup, workgroups);
    if index >= band.crowns {
        return;
    }
    let crown = crowns[index];
    let reach = reach_of(crown);
    let trunk_row = crown.y >> CELL_SHIFT;
    let trunk_col = crown.x >> CELL_SHIFT;
    var own: Tally;
    for (var row = reach.first_row + i32(lane.y); row <= reach.last_row; row += i32(SIDE)) {
        for (var col = reach.first_col + i32(lane.x); col <= reach.last_col; col += i32(SIDE)) {
            let cell = cell_of_band(row, col);
            if atomicLoad(&owner[cell]) != ~index {
                continue;
            }
            own.visible_cells += 1u;
            if extractBits(is_canopy[cell / 4u], 8u * (cell % 4u), 8u) != 0u {
                own.canopy_cells += 1u;
                own.sum_cols += col - trunk_col;
                own.sum_rows += row - trunk_row;
            }
        }
    }
    if own.visible_cells > 0u {
        atomicAdd(&visible_cells, own.visible_cells);
        atomicAdd(&canopy_cells, own.canopy_cells);
        atomicAdd(&sum_cols, own.sum_cols);
        atomicAdd(&sum_rows, own.sum_rows);
    }
    workgroupBarrier();
    if lane.x == 0u && lane.y == 0u {
        tallies[index].visible_cells += atomicLoad(&visible_cells);
        tallies[index].canopy_cells += atomicLoad(&canopy_cells);
        tallies[index].sum_cols += atomicLoad(&sum_cols);
        tallies[index].sum_rows += atomicLoad(&sum_rows);
    }
}
