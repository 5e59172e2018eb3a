//! A selection as its tables: GeoParquet and comma-separated values, as scene folders hold them.

use std::fs::File;
use std::path::Path;

use super::WriteError;
use super::instances::FeatureTable;
use super::selection::Selection;
use crate::plants::table::{self, TableFormat};
use crate::plants::{downed_logs_table, snags_table};
use crate::progress::Reporter;

/// Writes each table into an empty folder: `plants.parquet`, `snags.parquet`, `downed_logs.parquet`, or the same as `.csv`.
///
/// # Errors
/// If one cannot be written, or the run was cancelled.
pub fn write_folder(
    folder: &Path,
    selection: &Selection,
    format: TableFormat,
    reporter: &Reporter,
) -> Result<(), WriteError> {
    let stage = reporter.stage("tables", selection.len() as u64);
    for table in selection.tables() {
        let file = format!("{}.{}", table.name(), format.name());
        write_file(&folder.join(file), selection, table, format)?;
        stage.advance(selection.rows(table) as u64);
        reporter.check_cancelled()?;
    }
    Ok(())
}

/// Writes one table.
///
/// # Errors
/// If it cannot be written.
pub fn write_file(
    path: &Path,
    selection: &Selection,
    of: FeatureTable,
    format: TableFormat,
) -> Result<(), WriteError> {
    let Selection { biome, frame, .. } = selection;
    let out = File::create(path)?;
    match of {
        FeatureTable::Plants => table::write(out, &selection.plants, biome, frame, format)?,
        FeatureTable::Snags => {
            snags_table::write_snags(out, &selection.snags, biome, frame, format)?;
        }
        FeatureTable::DownedLogs => {
            let logs = &selection.downed_logs;
            downed_logs_table::write_downed_logs(out, logs, biome, frame, format)?;
        }
    }
    Ok(())
}
