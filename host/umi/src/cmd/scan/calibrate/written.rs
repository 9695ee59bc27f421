//! What a calibration writes beside its answer: the machine file, a table of residuals, a page.

use std::path::{Path, PathBuf};

use clap::Args;
use umi_report::pages::deviation::{DeviationPage, html};
use umi_scan::ScanError;

use crate::failure::Failure;
use crate::output::Force;

/// Where it goes; each on demand.
#[derive(Args)]
pub(super) struct Written {
    /// The machine file with what was found, all else as it is
    #[arg(short, long, value_name = "MACHINE.toml")]
    pub output: Option<PathBuf>,
    /// The residuals of each row that was given
    #[arg(long, value_name = "RESIDUALS.csv")]
    residuals: Option<PathBuf>,
    /// A page with the residuals where they are, on maps and in a view that turns
    #[arg(long, value_name = "PAGE.html")]
    report: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

impl Written {
    /// Refuses, before anything is reckoned, what may not be written, or not to one file.
    pub fn check(&self, inputs: &[&Path]) -> Result<(), Failure> {
        let outputs = [&self.output, &self.residuals, &self.report];
        let outputs: Vec<&PathBuf> = outputs.into_iter().flatten().collect();
        for (place, path) in outputs.iter().enumerate() {
            self.force.check(path, inputs)?;
            if outputs[..place].contains(path) {
                return Err(Failure::trouble(
                    "file",
                    "machine file, residuals and page need a file each",
                ));
            }
        }
        Ok(())
    }

    /// Writes what was asked for. All texts are made before the first file is: what is refused leaves none.
    pub fn write(
        &self,
        residuals: impl FnOnce() -> String,
        page: impl FnOnce() -> DeviationPage,
        machine: impl FnOnce() -> Result<String, ScanError>,
    ) -> Result<(), ScanError> {
        let machine = self.output.as_deref().map(|path| (path, machine()));
        let machine = machine.map(|(path, text)| text.map(|text| (path, text)));
        let texts = [
            machine.transpose()?,
            self.residuals.as_deref().map(|path| (path, residuals())),
            self.report.as_deref().map(|path| (path, html(&page()))),
        ];
        for (path, text) in texts.into_iter().flatten() {
            std::fs::write(path, text).map_err(|error| ScanError::file("write", path, &error))?;
        }
        Ok(())
    }
}

/// The text of a machine file, to be changed.
pub(super) fn text_of(machine: &Path) -> Result<String, ScanError> {
    std::fs::read_to_string(machine).map_err(|error| ScanError::file("read", machine, &error))
}
