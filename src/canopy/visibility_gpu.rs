//! Visibility on the graphics card: twin of [`super::visibility`], which defines the result; same names, same steps.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::crowns::{Crowns, MAX_RADIUS_UNITS, UNITS_PER_CELL};
use super::visibility::{CanopyCells, RenderVisibility, Visibility};
use crate::gpu::{Buffer, BufferUse, Device, GpuError, Kernel};

/// The kernels' text.
pub const WGSL: &str =
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/canopy/visibility.wgsl"));

/// Most cells worked on at once, unless one row has more. Chosen: 13 bytes a cell make 218 MB, which small cards have;
/// a landscape of 4096² cells is one band.
pub const MAX_CELLS_PER_BAND: usize = 1 << 24;

/// The band of rows that the kernels work on: the uniform of the WGSL text.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Band {
    /// First row of the band.
    pub first_row: u32,
    /// Rows of the band.
    pub rows: u32,
    /// Columns of the grid.
    pub cols: u32,
    /// Number of crowns.
    pub crowns: u32,
}

/// One of [`Crowns`], as the WGSL text has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Crown {
    /// From the grid's west edge eastward to the trunk.
    pub x: i32,
    /// From the grid's north edge southward to the trunk.
    pub y: i32,
    /// Radius of the sphere.
    pub radius: i32,
    /// Elevation of the sphere's centre, below 0 too.
    pub center_z: i32,
}

/// What is seen of one crown, as the WGSL text has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Tally {
    /// Cells seen of the crown.
    pub visible_cells: u32,
    /// Those that are canopy.
    pub canopy_cells: u32,
    /// Sum over those of columns east of the trunk's cell.
    pub sum_cols: i32,
    /// Sum over those of rows south of the trunk's cell.
    pub sum_rows: i32,
}

/// Bytes of a word: of a depth, an owner, or the canopy flags of four cells.
const WORD_BYTES: usize = size_of::<u32>();

/// The visibility step on a graphics card. Its buffers are kept between rounds.
#[derive(Debug)]
pub struct GpuVisibility {
    device: Device,
    raise_depth: Kernel,
    claim_cells: Kernel,
    tally_crowns: Kernel,
    band: Buffer,
    crowns: Buffer,
    depth: Buffer,
    owner: Buffer,
    is_canopy: Buffer,
    tallies: Buffer,
    answer: Buffer,
    cells_per_band: usize,
}

impl GpuVisibility {
    /// The step on `device`.
    ///
    /// # Errors
    /// If the card's driver cannot compile the kernels.
    pub fn new(device: &Device) -> Result<Self, GpuError> {
        Self::with_shader(device, WGSL)
    }

    /// As [`Self::new`] with another text for [`WGSL`]: tests give a wrong one and see that they notice.
    ///
    /// # Errors
    /// If the card's driver cannot compile the kernels.
    pub fn with_shader(device: &Device, wgsl: &str) -> Result<Self, GpuError> {
        let [raise_depth, claim_cells, tally_crowns] =
            device.kernels("visibility", wgsl, ["raise_depth", "claim_cells", "tally_crowns"])?;
        Ok(Self {
            raise_depth,
            claim_cells,
            tally_crowns,
            band: device.buffer("band of rows", BufferUse::Uniform),
            crowns: device.buffer("crowns", BufferUse::Storage),
            depth: device.buffer("heights of crowns", BufferUse::Storage),
            owner: device.buffer("crowns seen", BufferUse::Storage),
            is_canopy: device.buffer("canopy cells", BufferUse::Storage),
            tallies: device.buffer("tallies of crowns", BufferUse::Storage),
            answer: device.buffer("visibility", BufferUse::Answer),
            cells_per_band: MAX_CELLS_PER_BAND,
            device: device.clone(),
        })
    }

    /// The same with smaller bands, which change no result.
    pub fn with_cells_per_band(mut self, cells: usize) -> Self {
        self.cells_per_band = cells;
        self
    }

    /// Rows of a band: as many as the card's buffers hold, at least one.
    fn rows_per_band(&self, cols: usize) -> usize {
        // a limit beyond usize is no limit
        let held = usize::try_from(self.device.largest_storage_bytes()).unwrap_or(usize::MAX);
        (self.cells_per_band.min(held / WORD_BYTES) / cols).max(1)
    }

    fn try_render(
        &mut self,
        crowns: &Crowns,
        cells: CanopyCells<'_>,
        visibility: &mut Visibility,
    ) -> Result<(), GpuError> {
        let CanopyCells { rows, cols, is_canopy } = cells;
        assert_eq!(is_canopy.len(), rows * cols, "canopy flags do not fill the grid");
        let records = records(crowns);
        visibility.owner.clear();
        visibility.owner.reserve(rows * cols);
        set_tallies(visibility, &vec![Tally::default(); records.len()]);
        if rows == 0 || cols == 0 {
            return Ok(());
        }
        self.crowns.write(&records)?;
        let tally_bytes = size_of_val(&*records) as u64; // a tally is as long as a crown, usize at most 64 bits
        self.tallies.reserve(tally_bytes)?;

        let rows_per_band = self.rows_per_band(cols);
        for first_row in (0..rows).step_by(rows_per_band) {
            let band_rows = rows_per_band.min(rows - first_row);
            let in_band = first_row * cols..(first_row + band_rows) * cols;
            let cell_bytes = (in_band.len() * WORD_BYTES) as u64;
            self.band.write(&[Band {
                first_row: whole_u32(first_row),
                rows: whole_u32(band_rows),
                cols: whole_u32(cols),
                crowns: whole_u32(records.len()),
            }])?;
            self.is_canopy.write(&is_canopy[in_band.clone()])?;
            self.depth.reserve(cell_bytes)?;
            self.owner.reserve(cell_bytes)?;
            self.answer.reserve(cell_bytes + tally_bytes)?;
            let workgroups = whole_u32(records.len());
            self.device.submit("visibility", |commands| {
                if first_row == 0 {
                    commands.clear(&self.tallies, tally_bytes);
                }
                commands.clear(&self.depth, cell_bytes);
                commands.clear(&self.owner, cell_bytes);
                let band = (0, &self.band);
                let crowns = (1, &self.crowns);
                let depth = (2, &self.depth);
                let owner = (3, &self.owner);
                let is_canopy = (4, &self.is_canopy);
                let tallies = (5, &self.tallies);
                commands.dispatch(&self.raise_depth, &[band, crowns, depth], workgroups);
                commands.dispatch(&self.claim_cells, &[band, crowns, depth, owner], workgroups);
                commands.dispatch(
                    &self.tally_crowns,
                    &[band, crowns, owner, is_canopy, tallies],
                    workgroups,
                );
                commands.copy(&self.owner, &self.answer, 0, cell_bytes);
                commands.copy(&self.tallies, &self.answer, cell_bytes, tally_bytes);
            })?;
            let is_last = in_band.end == is_canopy.len();
            let words = in_band.len() + records.len() * size_of::<Tally>() / WORD_BYTES;
            self.device.read(&self.answer, words, |words: &[u32]| {
                let (owners, tallies) = words.split_at(in_band.len());
                // the kernels keep complements
                visibility.owner.par_extend(owners.par_iter().map(|complement| !complement));
                if is_last {
                    set_tallies(visibility, bytemuck::cast_slice(tallies));
                }
            })?;
        }
        Ok(())
    }
}

impl RenderVisibility for GpuVisibility {
    fn render(
        &mut self,
        crowns: &Crowns,
        cells: CanopyCells<'_>,
        visibility: &mut Visibility,
    ) -> Result<(), String> {
        self.try_render(crowns, cells, visibility).map_err(|error| error.to_string())
    }
}

/// Crowns one by one.
fn records(crowns: &Crowns) -> Vec<Crown> {
    let count = crowns.len();
    let lengths = [crowns.y.len(), crowns.radius.len(), crowns.center_z.len()];
    assert_eq!(lengths, [count; 3], "the arrays of crowns differ in length");
    let of = |index: usize| {
        let radius = crowns.radius[index];
        assert!(
            (1..=MAX_RADIUS_UNITS).contains(&radius),
            "crown {index} has a radius of {radius} units of 1/{UNITS_PER_CELL} cell"
        );
        Crown { x: crowns.x[index], y: crowns.y[index], radius, center_z: crowns.center_z[index] }
    };
    (0..count).into_par_iter().map(of).collect()
}

fn set_tallies(visibility: &mut Visibility, tallies: &[Tally]) {
    fn set<T: Copy>(into: &mut Vec<T>, tallies: &[Tally], of: impl Fn(&Tally) -> T) {
        into.clear();
        into.extend(tallies.iter().map(of));
    }
    set(&mut visibility.visible_cells, tallies, |tally| tally.visible_cells);
    set(&mut visibility.canopy_cells, tallies, |tally| tally.canopy_cells);
    set(&mut visibility.sum_cols, tallies, |tally| tally.sum_cols);
    set(&mut visibility.sum_rows, tallies, |tally| tally.sum_rows);
}

/// A count of cells or crowns as the kernels have it.
fn whole_u32(count: usize) -> u32 {
    assert!(
        count <= 1 << 26,
        "{count} rows, columns or crowns: positions in units would not fit i32"
    );
    count as u32 // below 2²⁶
}
