//! `flash`: puts an image into a board.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};

use crate::console;
use crate::tasks::firmware::boards::{self, Board, Flashing};
use crate::tasks::firmware::{self, uf2};
use crate::workspace::{Workspace, execute, find_program, shown};

/// Builds the firmware of a board and puts it into the board.
///
/// Through a debug probe with probe-rs, or, for a Pico whose BOOTSEL button was held while
/// it was plugged in, by copying a .uf2 file to the drive that it shows.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cargo xtask flash pico             # onto the drive if there is one, else with probe-rs\n  cargo xtask flash nucleo-h743 --run   # and show its log until Ctrl-C\n  cargo xtask flash pico2 --dry-run   # only say what would be done"
)]
pub(crate) struct Arguments {
    /// The board.
    board: String,
    /// Stays connected through the debug probe and shows the board's log.
    #[arg(long)]
    run: bool,
    /// Where the boot loader's drive is mounted, if it is not found.
    #[arg(long, value_name = "FOLDER", conflicts_with = "run")]
    drive: Option<PathBuf>,
    /// Says what would be done, and neither builds nor flashes.
    #[arg(long)]
    dry_run: bool,
}

/// The ways into a board that this machine has.
#[derive(Default)]
struct Ways {
    /// probe-rs.
    probe_rs: Option<PathBuf>,
    /// A boot loader's drive.
    drive: Option<PathBuf>,
}

/// What there is to do.
#[derive(Debug)]
enum Step {
    Run(Command),
    Copy { file: PathBuf, drive: PathBuf },
}

/// Builds and flashes what the arguments name.
pub fn run(workspace: &Workspace, arguments: &Arguments) -> Result<()> {
    let board = boards::find(&arguments.board)?;
    let drive = match (&board.flashing, &arguments.drive) {
        (Flashing::ProbeOrDrive { family, .. }, None) => find_drive(*family, &mounted()),
        (Flashing::ProbeOrDrive { family, .. }, Some(drive)) => {
            let found = find_drive(*family, std::slice::from_ref(drive));
            Some(found.with_context(|| {
                format!(
                    "{} is no drive of a {} in its boot loader: no INFO_UF2.TXT there says `Board-ID: {}`",
                    drive.display(),
                    board.name,
                    family.board_id()
                )
            })?)
        }
        (_, Some(_)) => bail!(
            "a {} shows no drive; flash it with a debug probe",
            board.name
        ),
        (_, None) => None,
    };
    let ways = Ways {
        probe_rs: find_program("probe-rs"),
        drive,
    };
    if arguments.dry_run {
        for line in rehearse(workspace, board, &ways, arguments.run)? {
            println!("{line}");
        }
        return Ok(());
    }
    let steps = plan(workspace, board, &ways, arguments.run)?;
    firmware::build(workspace, &[board], None)?;
    steps.into_iter().try_for_each(Step::take)
}

/// What would be done, as one would type it; if nothing can be yet, every way that there
/// could be, and what is missing.
fn rehearse(workspace: &Workspace, board: &Board, ways: &Ways, run: bool) -> Result<Vec<String>> {
    let lines = |ways: &Ways| -> Result<Vec<String>> {
        let steps = plan(workspace, board, ways, run)?;
        Ok(steps.iter().map(Step::as_line).collect())
    };
    let missing = match (lines(ways), &board.flashing) {
        (Err(missing), Flashing::Probe { .. } | Flashing::ProbeOrDrive { .. }) => missing,
        (lines, _) => return lines,
    };
    let mut all = vec![format!("# {missing}")];
    if let Flashing::ProbeOrDrive { family, .. } = &board.flashing
        && !run
    {
        all.push("# with its drive mounted:".to_owned());
        all.extend(lines(&Ways {
            drive: Some(family.board_id().into()),
            probe_rs: None,
        })?);
    }
    all.push("# with a debug probe:".to_owned());
    all.extend(lines(&Ways {
        drive: None,
        probe_rs: Some("probe-rs".into()),
    })?);
    Ok(all)
}

/// How the image gets into the board, or what to do so that it can.
fn plan(workspace: &Workspace, board: &Board, ways: &Ways, run: bool) -> Result<Vec<Step>> {
    let image = |end| workspace.firmware().join(format!("{}.{end}", board.name));
    let (chip, family) = match board.flashing {
        Flashing::Emulator => bail!(
            "the {} is QEMU's: `qemu-system-arm -machine mps2-an500 -kernel {}` runs it, and \
             `cargo xtask test` does, with something at its ports",
            board.name,
            image("elf").display()
        ),
        Flashing::Signed => bail!(
            "{} is a part of a signed board: `cargo xtask firmware {} --sign KEY` makes the whole",
            board.name,
            if board.name == "pico2-ab" {
                "pico2"
            } else {
                board.folder()
            }
        ),
        Flashing::Probe { chip } => (chip, None),
        Flashing::ProbeOrDrive { chip, family } => (chip, Some(family)),
    };
    // A board that shows its drive waits for a file: nothing else runs in it.
    if let Some(drive) = &ways.drive
        && !run
    {
        return Ok(vec![Step::Copy {
            file: image("uf2"),
            drive: drive.clone(),
        }]);
    }
    let Some(probe_rs) = &ways.probe_rs else {
        let probe = "to flash through a debug probe, install probe-rs: \
                     `cargo install --locked probe-rs-tools`, or see https://probe.rs";
        bail!(match family {
            Some(family) if !run => format!(
                "no way into the {} was found. Without a debug probe: hold BOOTSEL while plugging it \
                 in, mount the drive {} that appears, and repeat this (or give its folder with \
                 --drive). Or, {probe}",
                board.name,
                family.board_id()
            ),
            _ => format!("no probe-rs; {probe}"),
        });
    };
    let probe_rs = |verb: &str| {
        let mut command = workspace.command(probe_rs);
        command.args([verb, "--chip", chip]);
        command
    };
    let steps = if run {
        vec![("run", true)]
    } else {
        // `download` leaves the chip halted.
        vec![("download", true), ("reset", false)]
    };
    Ok(steps
        .into_iter()
        .map(|(verb, with_image)| {
            let mut command = probe_rs(verb);
            if with_image {
                command.arg(image("elf"));
            }
            Step::Run(command)
        })
        .collect())
}

impl Step {
    fn as_line(&self) -> String {
        match self {
            Self::Run(command) => shown(command),
            Self::Copy { file, drive } => {
                let mut command = Command::new("cp");
                command.arg(file).arg(drive);
                shown(&command)
            }
        }
    }

    fn take(self) -> Result<()> {
        match self {
            Self::Run(mut command) => execute(&mut command),
            Self::Copy { file, drive } => {
                console::progress(&format!("{} -> {}", file.display(), drive.display()));
                let name = file.file_name().unwrap_or(OsStr::new("image.uf2"));
                let mut to = fs::File::create(drive.join(name))
                    .with_context(|| format!("cannot write to {}", drive.display()))?;
                let bytes =
                    fs::read(&file).with_context(|| format!("cannot read {}", file.display()))?;
                std::io::Write::write_all(&mut to, &bytes)
                    .with_context(|| format!("{} did not take the image", drive.display()))?;
                // The drive goes away as soon as it has the last block, so an error here
                // says nothing.
                let _ = to.sync_all();
                console::progress("the board has its image and restarts");
                Ok(())
            }
        }
    }
}

/// Where drives are mounted: below these folders, or below a user's folder in them.
fn mounted() -> Vec<PathBuf> {
    let mut folders = Vec::new();
    for top in ["/media", "/run/media", "/mnt", "/Volumes"] {
        for folder in entries(Path::new(top)) {
            folders.extend(entries(&folder));
            folders.push(folder);
        }
    }
    // Windows gives drives letters.
    folders.extend(('D'..='Z').map(|letter| PathBuf::from(format!("{letter}:\\"))));
    folders
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    fs::read_dir(folder)
        .into_iter()
        .flatten()
        .filter_map(|entry| Some(entry.ok()?.path()))
        .collect()
}

/// The drive among `folders` that a boot loader of this family shows.
fn find_drive(family: uf2::Family, folders: &[PathBuf]) -> Option<PathBuf> {
    let is_drive = |folder: &&PathBuf| {
        fs::read_to_string(folder.join("INFO_UF2.TXT")).is_ok_and(|info| {
            info.lines()
                .filter_map(|line| line.strip_prefix("Board-ID:"))
                .any(|id| id.trim() == family.board_id())
        })
    };
    folders.iter().find(is_drive).cloned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasks::firmware::uf2::Family;

    /// A checkout whose `target` is an empty folder of its own.
    fn workspace(test: &str) -> Workspace {
        let root = std::env::temp_dir().join(format!("umi-xtask-{test}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&root);
        let workspace = Workspace {
            target: root.join("target"),
            root,
        };
        fs::create_dir_all(workspace.firmware()).unwrap();
        workspace
    }

    fn lines(workspace: &Workspace, board: &str, ways: &Ways, run: bool) -> Vec<String> {
        let steps = plan(workspace, boards::find(board).unwrap(), ways, run).unwrap();
        steps.iter().map(Step::as_line).collect()
    }

    /// Each way into each kind of board is the command that one would type.
    #[test]
    fn commands() {
        let workspace = Workspace {
            root: "/".into(),
            target: "/target".into(),
        };
        let probe = Ways {
            probe_rs: Some("/bin/probe-rs".into()),
            drive: None,
        };
        assert_eq!(
            lines(&workspace, "nucleo-h743", &probe, false),
            [
                "/bin/probe-rs download --chip STM32H743ZITx /target/firmware/nucleo-h743.elf",
                "/bin/probe-rs reset --chip STM32H743ZITx",
            ]
        );
        assert_eq!(
            lines(&workspace, "pico2", &probe, true),
            ["/bin/probe-rs run --chip RP235x /target/firmware/pico2.elf"]
        );
        let drive = Ways {
            drive: Some("/media/me/RPI-RP2".into()),
            ..probe
        };
        assert_eq!(
            lines(&workspace, "pico", &drive, false),
            ["cp /target/firmware/pico.uf2 /media/me/RPI-RP2"]
        );
        // The log comes through the probe only.
        assert_eq!(
            lines(&workspace, "pico", &drive, true),
            ["/bin/probe-rs run --chip RP2040 /target/firmware/pico.elf"]
        );
    }

    /// Without a way in, the answer is what to do.
    #[test]
    fn remedies() {
        let workspace = Workspace {
            root: "/".into(),
            target: "/target".into(),
        };
        let remedy = |board, run| {
            let board = boards::find(board).unwrap();
            plan(&workspace, board, &Ways::default(), run)
                .unwrap_err()
                .to_string()
        };
        let pico = remedy("pico", false);
        assert!(
            pico.contains("BOOTSEL") && pico.contains("probe-rs-tools"),
            "{pico}"
        );
        for text in [remedy("nucleo-h743", false), remedy("pico", true)] {
            assert!(
                text.contains("probe-rs-tools") && !text.contains("BOOTSEL"),
                "{text}"
            );
        }
        assert!(remedy("mps2-an500", false).contains("qemu-system-arm"));
    }

    /// A rehearsal needs neither board nor tool: it says what is missing, and what would be
    /// done with it. Of what is there it shows that only; a board of QEMU's has no way.
    #[test]
    fn rehearsals() {
        let workspace = Workspace {
            root: "/".into(),
            target: "/target".into(),
        };
        let rehearsed = |board, ways: &Ways, run| {
            rehearse(&workspace, boards::find(board).unwrap(), ways, run)
                .map(|lines| lines.join("\n"))
        };
        let download = "probe-rs download --chip RP2040 /target/firmware/pico.elf";
        let pico = rehearsed("pico", &Ways::default(), false).unwrap();
        assert!(pico.starts_with("# no way into the pico"), "{pico}");
        assert!(
            pico.contains("\ncp /target/firmware/pico.uf2 RPI-RP2\n"),
            "{pico}"
        );
        assert!(pico.contains(download), "{pico}");
        let nucleo = rehearsed("nucleo-h743", &Ways::default(), true).unwrap();
        assert!(
            nucleo.starts_with("# no probe-rs") && nucleo.contains("\nprobe-rs run"),
            "{nucleo}"
        );
        let probe = Ways {
            probe_rs: Some("probe-rs".into()),
            drive: None,
        };
        let pico = rehearsed("pico", &probe, false).unwrap();
        assert!(pico.starts_with(download), "{pico}");
        assert!(rehearsed("mps2-an500", &Ways::default(), false).is_err());
    }

    /// A boot loader's drive is known by what it says, not by its name, and only for its
    /// own chip; what is copied there is the image.
    #[test]
    fn drive() {
        let workspace = workspace("drive");
        let [other, drive] = ["RPI-RP2", "disk"].map(|name| workspace.root.join(name));
        fs::create_dir_all(&other).unwrap();
        fs::create_dir_all(&drive).unwrap();
        fs::write(
            drive.join("INFO_UF2.TXT"),
            "UF2 Bootloader v3.0\r\nModel: Raspberry Pi RP2\r\nBoard-ID: RPI-RP2\r\n",
        )
        .unwrap();
        let folders = [other, drive.clone()];
        assert_eq!(find_drive(Family::Rp2350, &folders), None);
        assert_eq!(find_drive(Family::Rp2040, &folders), Some(drive.clone()));

        fs::write(workspace.firmware().join("pico.uf2"), "blocks").unwrap();
        let ways = Ways {
            drive: Some(drive.clone()),
            ..Ways::default()
        };
        for step in plan(&workspace, boards::find("pico").unwrap(), &ways, false).unwrap() {
            step.take().unwrap();
        }
        assert_eq!(fs::read(drive.join("pico.uf2")).unwrap(), b"blocks");
        fs::remove_dir_all(&workspace.root).unwrap();
    }

    /// probe-rs gets the image and the chip; its failure is ours.
    #[cfg(unix)]
    #[test]
    fn probe_rs_is_called() {
        use std::os::unix::fs::PermissionsExt as _;
        let workspace = workspace("probe");
        let fake = workspace.root.join("probe-rs");
        let script = "#!/bin/sh\necho \"$@\" >> called\n[ \"$1\" != reset ] || exit 3\n";
        fs::write(&fake, script).unwrap();
        fs::set_permissions(&fake, fs::Permissions::from_mode(0o755)).unwrap();
        let ways = Ways {
            probe_rs: Some(fake),
            drive: None,
        };
        let steps = plan(&workspace, boards::find("pico").unwrap(), &ways, false).unwrap();
        let error = steps.into_iter().try_for_each(Step::take).unwrap_err();
        assert!(error.to_string().contains("reset"), "{error}");
        let elf = workspace.firmware().join("pico.elf");
        assert_eq!(
            fs::read_to_string(workspace.root.join("called")).unwrap(),
            format!(
                "download --chip RP2040 {}\nreset --chip RP2040\n",
                elf.display()
            )
        );
        fs::remove_dir_all(&workspace.root).unwrap();
    }
}
