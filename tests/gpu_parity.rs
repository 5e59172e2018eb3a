//! The visibility step on the graphics card gives the same bits as on the CPU. Without an adapter the tests say
//! "skipped: no adapter"; `REQUIRE_GPU=1` turns that into a failure. A software adapter will do.
#![cfg(feature = "gpu")]

use std::time::Instant;

use wildwood::canopy::crowns::{Crowns, MAX_RADIUS_UNITS, UNITS_PER_CELL};
use wildwood::canopy::visibility::{
    CanopyCells, CpuVisibility, NO_CROWN, RenderVisibility, Visibility,
};
use wildwood::canopy::visibility_gpu::{GpuVisibility, WGSL};
use wildwood::gpu::Device;
use wildwood::rng::{Key, Process, words};

/// Greatest height of a sphere's centre.
const MAX_CENTER_Z: i32 = (1 << 24) - 1;

/// Any adapter, or `None` where there is none and none is required.
fn device() -> Option<Device> {
    let device = Device::open_for_tests().expect("an adapter that cannot be opened");
    match &device {
        Some(device) => eprintln!("on {}", device.adapter()),
        None if std::env::var_os("REQUIRE_GPU").is_some() => panic!("no adapter"),
        None => eprintln!("skipped: no adapter"),
    }
    device
}

struct Case {
    name: String,
    rows: usize,
    cols: usize,
    is_canopy: Vec<bool>,
    crowns: Crowns,
}

impl Case {
    /// All cells canopy, no crown yet.
    fn new(name: &str, rows: usize, cols: usize) -> Self {
        let is_canopy = vec![true; rows * cols];
        Self { name: name.to_owned(), rows, cols, is_canopy, crowns: Crowns::default() }
    }

    fn crown(mut self, x: i32, y: i32, radius: i32, center_z: i32) -> Self {
        self.crowns.x.push(x);
        self.crowns.y.push(y);
        self.crowns.radius.push(radius);
        self.crowns.center_z.push(center_z);
        self
    }

    /// `count` crowns up to two cells beyond the edges, radii up to `max_radius`, centres in `levels` levels; two cells
    /// in three canopy.
    fn random(
        name: &str,
        [rows, cols]: [usize; 2],
        count: u64,
        max_radius: i32,
        levels: u32,
    ) -> Self {
        let mut case = Self::new(name, rows, cols);
        let of = |length: usize, word: u32| {
            let cells = length as u32 + 4;
            (word % (cells * UNITS_PER_CELL as u32)) as i32 - 2 * UNITS_PER_CELL
        };
        for entity in 0..count {
            let draw = |seed| {
                words(Key { seed, process: Process::StrewnPoints, year: 0, month: 0, entity })
            };
            let [x, y, radius, z] = draw(1);
            let radius = 1 + (radius % max_radius as u32) as i32;
            case = case.crown(of(cols, x), of(rows, y), radius, 1000 + (z % levels) as i32);
        }
        for (index, is_canopy) in case.is_canopy.iter_mut().enumerate() {
            let entity = index as u64;
            let key = Key { seed: 2, process: Process::StrewnPoints, year: 0, month: 0, entity };
            *is_canopy = !words(key)[0].is_multiple_of(3);
        }
        case
    }

    fn cells(&self) -> CanopyCells<'_> {
        CanopyCells { rows: self.rows, cols: self.cols, is_canopy: &self.is_canopy }
    }
}

fn cases() -> Vec<Case> {
    let middle = |cells: i32| cells * UNITS_PER_CELL + UNITS_PER_CELL / 2;
    let mut cases = vec![
        Case::new("nothing at all", 0, 0),
        Case::new("a crown and no cells", 0, 5).crown(10, 10, 50, 0),
        Case::new("cells and no crown", 3, 5),
        Case::new("one cell, one crown", 1, 1).crown(16, 16, 1, 0),
        Case::new("one cell, missed by a unit", 1, 1).crown(18, 16, 1, 0),
        Case::new("cells at exactly the radius", 5, 5).crown(middle(2), middle(2), 64, 77),
        Case::new("3, 4, 5 units", 1, 2).crown(19, 20, 5, 9),
        Case::new("equals: the lower index", 6, 6)
            .crown(middle(3), middle(2), 64, 500)
            .crown(middle(2), middle(2), 64, 500)
            .crown(middle(2), middle(2), 64, 500),
        Case::new("higher behind lower", 6, 6).crown(middle(2), middle(2), 80, 100).crown(
            middle(3),
            middle(3),
            80,
            900,
        ),
        Case::new("contained and buried", 9, 9).crown(middle(4), middle(4), 32, 0).crown(
            middle(4),
            middle(4),
            128,
            0,
        ),
        Case::new("largest radius", 150, 140)
            .crown(middle(70), middle(75), MAX_RADIUS_UNITS, 0)
            .crown(middle(71) + 3, middle(74) - 7, MAX_RADIUS_UNITS - 1, 5),
        Case::new("highest and lowest", 8, 8)
            .crown(middle(3), middle(3), MAX_RADIUS_UNITS, MAX_CENTER_Z)
            .crown(middle(4), middle(4), MAX_RADIUS_UNITS, MAX_CENTER_Z)
            .crown(middle(4), middle(4), 1, 0),
        Case::new("centres below the datum", 8, 8)
            .crown(middle(3), middle(3), 90, -60)
            .crown(middle(4), middle(3), 100, -1)
            .crown(middle(2), middle(5), 80, -81)
            .crown(middle(6), middle(5), 70, -MAX_CENTER_Z)
            .crown(middle(5), middle(6), 50, 0),
        Case::new("trunks beyond every edge", 4, 6)
            .crown(-33, 40, 100, 10)
            .crown(40, -1, 60, 20)
            .crown(6 * 32 + 40, 64, 90, 30)
            .crown(100, 4 * 32 + 1, 50, 40)
            .crown(-5000, 40, 100, 50)
            .crown(1 << 28, -(1 << 28), 2000, 60),
        Case::random("one row", [1, 700], 60, 300, 50),
        Case::random("one column", [700, 1], 60, 300, 50),
        Case::random("1-unit radii", [40, 40], 4000, 1, 9),
        Case::random("small radii", [40, 40], 4000, 20, 9),
        Case::random("few heights", [61, 67], 900, 150, 2),
        Case::random("many heights", [129, 63], 2000, 200, 4000),
        Case::random("all sizes", [300, 200], 500, MAX_RADIUS_UNITS, 1500),
        Case::random("more crowns than a row of workgroups", [256, 256], 70_000, 40, 3000),
    ];
    let mut bare = Case::random("no canopy at all", [30, 30], 50, 200, 50);
    bare.is_canopy.fill(false);
    cases.push(bare);
    cases
}

/// What the sky sees, crown after crown over all cells that could be under it, in wide whole numbers.
fn reference(case: &Case) -> Visibility {
    let units = i64::from(UNITS_PER_CELL);
    let crowns = &case.crowns;
    let mut seen = Visibility {
        owner: vec![NO_CROWN; case.rows * case.cols],
        visible_cells: vec![0; crowns.len()],
        canopy_cells: vec![0; crowns.len()],
        sum_cols: vec![0; crowns.len()],
        sum_rows: vec![0; crowns.len()],
    };
    let mut highest = vec![i64::MIN; case.rows * case.cols];
    for index in 0..crowns.len() {
        let [x, y, radius, center_z] =
            [&crowns.x, &crowns.y, &crowns.radius, &crowns.center_z].map(|of| i64::from(of[index]));
        let around = |at: i64, length: usize| {
            let first = (at - radius).div_euclid(units).clamp(0, length as i64);
            let end = ((at + radius).div_euclid(units) + 1).clamp(0, length as i64);
            first as usize..end as usize
        };
        for row in around(y, case.rows) {
            for col in around(x, case.cols) {
                let dx = col as i64 * units + units / 2 - x;
                let dy = row as i64 * units + units / 2 - y;
                let left = radius * radius - dx * dx - dy * dy;
                let cell = row * case.cols + col;
                if left >= 0 && center_z + left.isqrt() > highest[cell] {
                    highest[cell] = center_z + left.isqrt();
                    seen.owner[cell] = index as u32;
                }
            }
        }
    }
    for row in 0..case.rows {
        for col in 0..case.cols {
            let cell = row * case.cols + col;
            if seen.owner[cell] == NO_CROWN {
                continue;
            }
            let owner = seen.owner[cell] as usize;
            seen.visible_cells[owner] += 1;
            if case.is_canopy[cell] {
                seen.canopy_cells[owner] += 1;
                seen.sum_cols[owner] += col as i32 - crowns.x[owner].div_euclid(UNITS_PER_CELL);
                seen.sum_rows[owner] += row as i32 - crowns.y[owner].div_euclid(UNITS_PER_CELL);
            }
        }
    }
    seen
}

/// The first place where two arrays differ, with both values.
fn first_difference<T: PartialEq + std::fmt::Debug>(
    name: &str,
    found: &[T],
    wanted: &[T],
) -> Option<String> {
    if found.len() != wanted.len() {
        return Some(format!("{name}: {} values, not {}", found.len(), wanted.len()));
    }
    let at = (0..found.len()).find(|&index| found[index] != wanted[index])?;
    Some(format!("{name}[{at}] is {:?}, not {:?}", found[at], wanted[at]))
}

/// Renders the cases one after the other, so that buffers are kept from each to the next, and tells what differs.
fn differences(renderer: &mut dyn RenderVisibility, cases: &[Case]) -> Vec<String> {
    let mut visibility = Visibility::default();
    let mut found = Vec::new();
    for case in cases {
        renderer.render(&case.crowns, case.cells(), &mut visibility).unwrap();
        let wanted = reference(case);
        let first = first_difference("owner", &visibility.owner, &wanted.owner)
            .or_else(|| {
                let [found, wanted] = [&visibility, &wanted].map(|seen| &seen.visible_cells);
                first_difference("visible_cells", found, wanted)
            })
            .or_else(|| {
                let [found, wanted] = [&visibility, &wanted].map(|seen| &seen.canopy_cells);
                first_difference("canopy_cells", found, wanted)
            })
            .or_else(|| first_difference("sum_cols", &visibility.sum_cols, &wanted.sum_cols))
            .or_else(|| first_difference("sum_rows", &visibility.sum_rows, &wanted.sum_rows));
        found.extend(first.map(|difference| format!("{}: {difference}", case.name)));
    }
    found
}

#[test]
fn visibility_is_equal_bit_for_bit() {
    let Some(device) = device() else { return };
    let mut renderer = GpuVisibility::new(&device).unwrap();
    let mut cases = cases();
    let found = differences(&mut renderer, &cases);
    assert!(found.is_empty(), "{}", found.join("\n"));
    // once more with buffers that other cases have grown and filled
    cases.reverse();
    let found = differences(&mut renderer, &cases);
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn the_cpu_twin_is_equal_too() {
    let found = differences(&mut CpuVisibility, &cases());
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn bands_change_nothing() {
    let Some(device) = device() else { return };
    let mut cases = cases();
    cases.retain(|case| case.rows <= 150);
    for cells in [1, 100, 1000] {
        let mut renderer = GpuVisibility::new(&device).unwrap().with_cells_per_band(cells);
        let found = differences(&mut renderer, &cases);
        assert!(found.is_empty(), "{cells} cells a band: {}", found.join("\n"));
    }
}

#[test]
fn wrong_kernels_are_found_out() {
    let Some(device) = device() else { return };
    let mut cases = cases();
    cases.retain(|case| case.crowns.len() < 1000);
    let wrong = [
        ("if left < 0 {", "if left <= 0 {"),
        ("dx * dx + dy * dy", "dx * dx - dy * dy"),
        ("here == atomicLoad(&depth[cell])", "here <= atomicLoad(&depth[cell])"),
        ("atomicMax(&owner[cell]", "atomicAdd(&owner[cell]"),
        ("atomicMax(&depth", "atomicAdd(&depth"),
        ("i32(band.cols) - 1)", "i32(band.cols) - 2)"),
        ("^ 0x80000000u", "^ 0u"),
        ("8u) != 0u", "8u) == 0u"),
        ("row - trunk_row", "row + trunk_row"),
        ("let trunk_col = crown.x >> CELL_SHIFT;", "let trunk_col = crown.x / 32;"),
        ("sqrt(f32(square))", "1.1 * sqrt(f32(square))"),
    ];
    for (right, changed) in wrong {
        let text = WGSL.replace(right, changed);
        assert_ne!(text, WGSL, "the kernel has no `{right}` any more");
        let mut renderer = GpuVisibility::with_shader(&device, &text).unwrap();
        let found = differences(&mut renderer, &cases);
        assert_ne!(found.len(), 0, "`{changed}` for `{right}` goes unnoticed");
    }
}

/// Seconds a round, for `cargo test --release --test gpu_parity -- --ignored --nocapture`.
#[test]
#[ignore = "measures"]
fn seconds_a_round() {
    let Some(device) = device() else { return };
    let mut renderer = GpuVisibility::new(&device).unwrap();
    let mut visibility = Visibility::default();
    for (side, count) in [(1024, 70_000), (2048, 357_000), (3072, 745_000)] {
        let case = Case::random("stand", [side, side], count, 200, 3000);
        let mut seconds = Vec::new();
        for _ in 0..6 {
            let started = Instant::now();
            renderer.render(&case.crowns, case.cells(), &mut visibility).unwrap();
            seconds.push(started.elapsed().as_secs_f64());
        }
        let mut on_cpu = f64::INFINITY;
        for _ in 0..3 {
            let started = Instant::now();
            CpuVisibility.render(&case.crowns, case.cells(), &mut visibility).unwrap();
            on_cpu = on_cpu.min(started.elapsed().as_secs_f64());
        }
        let first = seconds.remove(0);
        let best = seconds.iter().copied().fold(f64::INFINITY, f64::min);
        println!(
            "{side}² cells, {count} crowns: first {first:.4} s, best of 5 more {best:.4} s, CPU {on_cpu:.4} s"
        );
    }
}
