//! Readers of others: what they cannot bear in a damaged file is that file's fault, not the end of the program.

use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::ScanError;
use crate::cloud::ScanCloud;

/// What a reader finds; `bad_file` with what it says, or if it gives up altogether.
pub(super) fn guarded(
    format: &str,
    read: impl FnOnce() -> Result<ScanCloud, String>,
) -> Result<ScanCloud, ScanError> {
    let told = match catch_unwind(AssertUnwindSafe(read)) {
        Ok(Ok(cloud)) => return Ok(cloud),
        Ok(Err(told)) => told,
        Err(_) => "its reader gives up".to_owned(),
    };
    Err(ScanError::unreadable(
        "bad_file",
        format_args!("it is no {format} file that can be read: {told}"),
    ))
}
