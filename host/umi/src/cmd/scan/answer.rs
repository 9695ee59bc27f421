//! How every command of this group answers.
//!
//! With `--json` one object on standard output. What is refused ends with status 2, a file
//! that cannot be understood with status 1, both as `{"error":{"code":…,"message":…}}`.

use serde::Serialize;
use umi_client::problem::{Problem, ProblemKind};
use umi_experiment::scan::mount::MountError;
use umi_scan::{Ending, ScanError};

use crate::failure::Failure;
use crate::show::terminal::{print, print_as_json};

/// Prints an answer, as one JSON object or as the text that `show` makes of it.
pub fn answer<T: Serialize>(
    result: Result<T, ScanError>,
    json: bool,
    show: impl FnOnce(&T) -> String,
) -> Result<(), Failure> {
    let found = result.map_err(failure)?;
    if !json {
        return print(&show(&found));
    }
    print_as_json(&found)
}

/// The exit status and the words for what did not end well.
pub fn failure(error: ScanError) -> Failure {
    Failure::Told(Problem {
        kind: match error.ending {
            Ending::Unreadable => ProblemKind::Trouble,
            Ending::Refused => ProblemKind::Refused,
        },
        code: error.code,
        message: error.message,
        details: error.details,
    })
}

/// The same for a mount that was not found.
pub fn mount_failure(error: MountError) -> Failure {
    match error {
        MountError::Scan(error) => failure(error),
        MountError::Scene(error) => Failure::trouble("scene", error),
    }
}
