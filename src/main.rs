//! The `wildwood` command: parses, calls the library, reports.

use std::process::ExitCode;

fn main() -> ExitCode {
    wildwood::cli::main()
}
