//! `bench`: openumi and its peers on the same data in the same run.
//!
//! The work itself is in `tests/bench`: here it is timed, counted, compared and written
//! down. Timings are never a pass or a fail; a peer that comes to another answer is.

mod chip;
mod figures;
mod report;
mod typed;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};

use self::figures::Figures;
use crate::console;
use crate::tools::python;
use crate::workspace::{Workspace, execute, find_program, output};

/// Measures openumi against its peers and writes the table of tests/bench/RESULTS.md.
///
/// Times everything that `tests/bench` does, counts its instructions with valgrind (they
/// repeat from run to run, which seconds do not), and lets SciPy do the same in a virtual
/// environment of its own. QEMU counts what the same work costs a board. What is missing is
/// skipped by name.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cargo xtask bench\n  cargo xtask bench --print   # leaves RESULTS.md as it is"
)]
pub(crate) struct Arguments {
    /// Prints the table instead of writing it.
    #[arg(long)]
    print: bool,
}

/// Measures.
pub fn run(workspace: &Workspace, arguments: &Arguments) -> Result<()> {
    execute(
        workspace
            .cargo()
            .args(["build", "--release", "--manifest-path"])
            .arg(manifest(workspace))
            .env("CARGO_TARGET_DIR", &workspace.target),
    )?;
    let program = workspace.target.join("release").join("umi-bench");
    let data = workspace.target.join("bench");
    execute(workspace.command(&program).arg("write").arg(&data))?;

    console::progress("timing umi-core and its peers in Rust");
    let mut all = Figures::parse_all(&output(workspace.command(&program).arg("time"))?)?;
    count(workspace, &program, &mut all)?;
    match by_python(workspace, &data) {
        Ok(peers) => all.extend(peers),
        Err(error) => console::skipped(&format!("SciPy: {error:#}")),
    }
    all.push(typed::rewriting(workspace, &program, &data)?);
    figures::check_agreement(&all)?;

    let mut report = report::markdown(&Machine::of(workspace)?, &all);
    if let Some(costs) = chip::costs(workspace)? {
        report.push_str(&chip::markdown(&costs));
    }
    if arguments.print {
        print!("{report}");
        return Ok(());
    }
    let file = workspace.root.join("tests/bench/RESULTS.md");
    std::fs::write(&file, report).with_context(|| format!("cannot write {}", file.display()))?;
    console::progress(&format!("wrote {}", file.display()));
    Ok(())
}

/// The benchmarks' workspace.
pub fn manifest(workspace: &Workspace) -> PathBuf {
    workspace.root.join("tests/bench/Cargo.toml")
}

/// What the figures were taken on.
pub(crate) struct Machine {
    /// The processor, as it names itself.
    pub processor: String,
    /// Its cores.
    pub cores: usize,
    /// The compiler.
    pub rustc: String,
}

impl Machine {
    fn of(workspace: &Workspace) -> Result<Self> {
        let cpuinfo = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let named = |line: &str| {
            line.strip_prefix("model name")?
                .split_once(": ")
                .map(|(_, name)| name.to_owned())
        };
        Ok(Self {
            processor: cpuinfo
                .lines()
                .find_map(named)
                .unwrap_or_else(|| std::env::consts::ARCH.to_owned()),
            cores: std::thread::available_parallelism()?.get(),
            rustc: output(workspace.command("rustc").arg("--version"))?
                .trim()
                .to_owned(),
        })
    }
}

/// Adds the instructions of one call to each contender, if valgrind is there.
fn count(workspace: &Workspace, program: &Path, all: &mut [Figures]) -> Result<()> {
    if find_program("valgrind").is_none() {
        console::skipped("instruction counts: no valgrind; `cargo xtask set-up` brings it");
        return Ok(());
    }
    console::progress("counting instructions");
    // The difference of two counts leaves out start and end of the program.
    const FEW: u32 = 10;
    const MANY: u32 = 110;
    for figures in all {
        let total = |times: u32| -> Result<u64> {
            let run = workspace
                .command("valgrind")
                .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
                .arg(program)
                .args(["repeat", &figures.task, &figures.by, &times.to_string()])
                .output()
                .context("cannot start valgrind")?;
            figures::instructions(&String::from_utf8_lossy(&run.stderr))
        };
        let calls = u64::from(MANY - FEW);
        figures.instructions = Some((total(MANY)? - total(FEW)?) / calls);
    }
    Ok(())
}

/// SciPy's figures, from a virtual environment in the target directory.
fn by_python(workspace: &Workspace, data: &Path) -> Result<Vec<Figures>> {
    let python = environment(workspace)?;
    console::progress("timing SciPy");
    let text = output(
        workspace
            .command(python)
            .arg(workspace.root.join("tests/bench/peers.py"))
            .arg(data)
            // One thread, as everyone else.
            .envs(["OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"].map(|name| (name, "1"))),
    )?;
    Figures::parse_all(&text)
}

/// The Python that has SciPy, installed if need be.
fn environment(workspace: &Workspace) -> Result<PathBuf> {
    let folder = workspace.target.join("bench").join("python");
    let python = python::interpreter(&folder);
    let has_scipy = |python: &Path| {
        python.is_file() && output(workspace.command(python).args(["-c", "import scipy"])).is_ok()
    };
    if has_scipy(&python) {
        return Ok(python);
    }
    console::progress("installing SciPy into the target directory");
    python::install(workspace, &folder, &["numpy", "scipy"])?;
    Ok(python)
}
