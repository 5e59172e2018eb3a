//! The spatial index of a layer, packed at once: an R-tree as SQLite's module stores it.
//!
//! Inserting a million boxes one by one takes several seconds; sorting them into tiles and writing full nodes takes a few
//! tenths, and gives a tighter tree. The module's own tables hold the nodes, so they are written as it would write them.
//!
//! # Reference
//! Leutenegger, Lopez & Edgington 1997, STR: a simple and efficient algorithm for R-tree packing, doi:10.1109/ICDE.1997.582015;
//! the head of SQLite's ext/rtree/rtree.c for the format of nodes.

use rayon::prelude::*;
use rusqlite::{Connection, params};

use super::Bounds;

/// Bytes of a node before its cells: depth of the tree (in the root), number of cells.
const HEAD_BYTES: usize = 4;

/// Bytes of a cell: what it leads to, and west, east, south, north in single precision.
const CELL_BYTES: usize = 24;

/// The node that the tree begins with.
const ROOT: i64 = 1;

/// What a node leads to, with bounds rounded outward: a row or another node, west, south, east and north.
#[derive(Clone, Copy, Debug)]
struct Cell {
    leads_to: i64,
    bounds: [f32; 4],
}

impl Cell {
    fn middle(&self, axis: usize) -> f32 {
        self.bounds[axis] + self.bounds[axis + 2]
    }
}

/// Makes the index of a layer whose row `fid` has the bounds at `fid − 1`.
pub fn create(connection: &Connection, layer: &str, boxes: &[Bounds]) -> rusqlite::Result<()> {
    let index = format!("rtree_{layer}_geom");
    connection.execute_batch(&format!(
        "CREATE VIRTUAL TABLE \"{index}\" USING rtree(id, minx, maxx, miny, maxy)"
    ))?;
    // the module puts an empty root there, as long as nodes have to be
    let node_bytes: u32 = connection.query_row(
        &format!("SELECT length(data) FROM \"{index}_node\" WHERE nodeno = 1"),
        [],
        |row| row.get(0),
    )?;
    let node_bytes = node_bytes as usize; // a page at most
    let fan_out = (node_bytes - HEAD_BYTES) / CELL_BYTES;

    // leaves, then the nodes above them, up to the root
    let mut cells: Vec<Cell> = boxes
        .par_iter()
        .enumerate()
        .map(|(row, bounds)| Cell { leads_to: row as i64 + 1, bounds: outward(bounds) })
        .collect();
    let mut leaf_of_row = vec![0_i64; boxes.len()];
    let mut next_node = ROOT + 1;
    let mut depth: u16 = 0;
    let mut node_row =
        connection.prepare(&format!("INSERT OR REPLACE INTO \"{index}_node\" VALUES (?1, ?2)"))?;
    let mut parent_row =
        connection.prepare(&format!("INSERT INTO \"{index}_parent\" VALUES (?1, ?2)"))?;
    loop {
        let is_root = cells.len() <= fan_out;
        let sizes = tile(&mut cells, fan_out);
        let mut above = Vec::with_capacity(sizes.len());
        let mut rest = &cells[..];
        for size in sizes {
            let (inside, others) = rest.split_at(size);
            rest = others;
            let node = if is_root { ROOT } else { next_node };
            let bytes = node_bytes_of(inside, if is_root { depth } else { 0 }, node_bytes);
            node_row.execute(params![node, bytes])?;
            for cell in inside {
                if depth == 0 {
                    leaf_of_row[cell.leads_to as usize - 1] = node; // rows count from 1
                } else {
                    parent_row.execute([cell.leads_to, node])?;
                }
            }
            above.push(Cell { leads_to: node, bounds: union(inside) });
            next_node += 1;
        }
        if is_root {
            break;
        }
        cells = above;
        depth += 1;
    }
    let mut rowid_row =
        connection.prepare(&format!("INSERT INTO \"{index}_rowid\" VALUES (?1, ?2)"))?;
    for (fid, node) in (1_i64..).zip(leaf_of_row) {
        rowid_row.raw_bind_parameter(1, fid)?;
        rowid_row.raw_bind_parameter(2, node)?;
        rowid_row.raw_execute()?;
    }
    Ok(())
}

/// Bounds in single precision that hold those in double.
fn outward(bounds: &Bounds) -> [f32; 4] {
    let nearest = bounds.map(|edge| edge as f32); // rounded outward next
    std::array::from_fn(|edge| {
        let is_low = edge < 2;
        match f64::from(nearest[edge]) {
            found if is_low && found > bounds[edge] => nearest[edge].next_down(),
            found if !is_low && found < bounds[edge] => nearest[edge].next_up(),
            _ => nearest[edge],
        }
    })
}

fn union(cells: &[Cell]) -> [f32; 4] {
    let none = [f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY];
    cells.iter().fold(none, |[west, south, east, north], Cell { bounds: b, .. }| {
        [west.min(b[0]), south.min(b[1]), east.max(b[2]), north.max(b[3])]
    })
}

/// Sorts cells so that those of a node stand together: in stripes from west to east, each from south to north. Gives how many
/// each node takes, at most `fan_out`; no cells take one empty node.
fn tile(cells: &mut [Cell], fan_out: usize) -> Vec<usize> {
    let nodes = cells.len().div_ceil(fan_out).max(1);
    let stripes = nodes.isqrt().max(1);
    let by = |axis: usize| {
        move |a: &Cell, b: &Cell| {
            // what they lead to makes all cells differ: the order is the same on any number of threads
            a.middle(axis).total_cmp(&b.middle(axis)).then(a.leads_to.cmp(&b.leads_to))
        }
    };
    cells.par_sort_unstable_by(by(0));
    let nodes_of_stripe = shares(nodes, stripes);
    let sizes = shares(cells.len(), nodes);
    let mut first = 0;
    let mut stripes_of_cells = Vec::with_capacity(stripes);
    let mut rest = cells;
    for count in nodes_of_stripe {
        let size: usize = sizes[first..first + count].iter().sum();
        first += count;
        let (stripe, others) = rest.split_at_mut(size);
        stripes_of_cells.push(stripe);
        rest = others;
    }
    stripes_of_cells.into_par_iter().for_each(|stripe| stripe.sort_unstable_by(by(1)));
    sizes
}

/// A number in so many parts that differ by one at most.
fn shares(whole: usize, parts: usize) -> Vec<usize> {
    (0..parts).map(|part| (part + 1) * whole / parts - part * whole / parts).collect()
}

/// A node as SQLite stores it, big-endian, filled up with zeros.
fn node_bytes_of(cells: &[Cell], depth: u16, node_bytes: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(node_bytes);
    bytes.extend_from_slice(&depth.to_be_bytes());
    bytes.extend_from_slice(&(cells.len() as u16).to_be_bytes()); // at most some dozens
    for Cell { leads_to, bounds: [west, south, east, north] } in cells {
        bytes.extend_from_slice(&leads_to.to_be_bytes());
        for edge in [west, east, south, north] {
            bytes.extend_from_slice(&edge.to_be_bytes());
        }
    }
    bytes.resize(node_bytes, 0);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_rounded_outward() {
        let exact = [500_000.1, 4_100_000.3, 500_000.1, 4_100_000.3];
        let [west, south, east, north] = outward(&exact).map(f64::from);
        assert!(west <= exact[0] && south <= exact[1] && east >= exact[2] && north >= exact[3]);
        assert!(east - west < 0.1 && north - south < 1.0);
        assert_eq!(outward(&[1.0, -2.5, 1.0, -2.5]), [1.0, -2.5, 1.0, -2.5]);
    }

    #[test]
    fn every_cell_is_in_one_node_and_no_node_is_too_full() {
        for count in [0, 1, 51, 52, 1000, 7919] {
            let mut cells: Vec<Cell> = (0..count)
                .map(|i| {
                    let [x, y] = [(i * 37 % 1009) as f32, (i * 61 % 997) as f32];
                    Cell { leads_to: i, bounds: [x, y, x, y] }
                })
                .collect();
            let sizes = tile(&mut cells, 51);
            assert_eq!(sizes.iter().sum::<usize>(), count as usize);
            assert!(sizes.iter().all(|size| *size <= 51), "{count}");
            let mut ids: Vec<i64> = cells.iter().map(|cell| cell.leads_to).collect();
            ids.sort_unstable();
            assert!(ids.into_iter().eq(0..count));
        }
    }
}
