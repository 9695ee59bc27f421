//! The console lines of the README and of the example of a line scanner: each is run as it is printed.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::rig::run::{Folder, project};

/// Lines that build instead of running `umi`. The test command runs the first; it is the second;
/// the third builds the crate whose binary this test runs.
const BUILDS: [&str; 3] = [
    "cargo run --release -- demo",
    "cargo xtask test",
    "cargo install --path host/umi",
];

/// The lines of every `sh` block, block by block; a line that ends in `\` goes on.
fn blocks(text: &str) -> Vec<Vec<String>> {
    let mut blocks = Vec::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        if line != "```sh" {
            continue;
        }
        let block: Vec<&str> = lines.by_ref().take_while(|line| *line != "```").collect();
        let whole = block.join("\n").replace("\\\n", " ");
        blocks.push(whole.lines().map(str::to_owned).collect());
    }
    blocks
}

/// What runs behind the others until the block ends.
struct Behind(Vec<Child>);

impl Drop for Behind {
    fn drop(&mut self) {
        for child in &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// A shell's command line in this folder, `umi` being the one that was built.
fn shell(line: &str, folder: &str, port: Option<&str>) -> Command {
    let umi = Path::new(env!("CARGO_BIN_EXE_umi"));
    let mut paths = vec![umi.parent().unwrap().to_owned()];
    paths.extend(std::env::split_paths(&std::env::var_os("PATH").unwrap()));
    let mut command = Command::new("sh");
    command
        // What is killed is the command, not a shell in front of it.
        .args(["-c", &format!("exec {line}")])
        .current_dir(folder)
        .env("PATH", std::env::join_paths(paths).unwrap())
        .env_remove("UMI_PORT")
        .stdin(Stdio::null());
    if let Some(port) = port {
        command.env("UMI_PORT", port);
    }
    command
}

/// A folder that looks like the repository to the README's lines.
fn desk() -> Folder {
    let folder = Folder::new();
    for name in ["examples", "hw"] {
        copy(Path::new(&project(name)), Path::new(&folder.path(name)));
    }
    folder
}

fn copy(from: &Path, to: &Path) {
    if from.is_dir() {
        std::fs::create_dir_all(to).unwrap();
        for entry in std::fs::read_dir(from).unwrap() {
            let entry = entry.unwrap();
            copy(&entry.path(), &to.join(entry.file_name()));
        }
    } else {
        std::fs::copy(from, to).unwrap();
    }
}

/// Every console line of the README ends well where it stands, after those before it.
#[test]
#[cfg(unix)]
fn every_console_line_runs_as_printed() {
    let text = std::fs::read_to_string(project("README.md")).unwrap();
    assert!(
        text.lines().count() <= 120,
        "the README is at most 120 lines"
    );
    assert!(run_lines(&text) >= 18);
}

/// Those of the line scanner's example do, from the same folder.
#[test]
#[cfg(unix)]
fn every_line_of_the_line_scanner_runs_as_printed() {
    let text = std::fs::read_to_string(project("examples/line-scan/README.md")).unwrap();
    assert!(run_lines(&text) >= 11);
}

/// Runs every console line of a text in a new folder; how many there were.
#[cfg(unix)]
fn run_lines(text: &str) -> u32 {
    let folder = desk();
    let mut run = 0;
    for block in blocks(text) {
        let mut behind = Behind(Vec::new());
        let mut port: Option<String> = None;
        for line in &block {
            if BUILDS.contains(&line.as_str()) {
                continue;
            }
            run += 1;
            if let Some(value) = line.strip_prefix("export UMI_PORT=") {
                port = Some(value.to_owned());
                wait_for(value);
                continue;
            }
            assert!(line.starts_with("umi "), "who runs {line:?}?");
            if let Some(line) = line.strip_suffix(" &") {
                let mut command = shell(line, &folder.path("."), None);
                behind
                    .0
                    .push(command.stdout(Stdio::null()).spawn().unwrap());
                continue;
            }
            let ran = shell(line, &folder.path("."), port.as_deref())
                .output()
                .unwrap();
            let said = String::from_utf8_lossy(&ran.stderr);
            assert!(ran.status.success(), "{line}\n{said}");
            // What it says goes into a file where the line says so.
            let is_kept = line.contains(" > ");
            assert!(is_kept || !ran.stdout.is_empty(), "{line} says nothing");
        }
    }
    run
}

/// Waits until the port listens: a person types slower.
fn wait_for(address: &str) {
    let address = address.strip_prefix("tcp://").unwrap();
    let end = Instant::now() + Duration::from_secs(10);
    while std::net::TcpStream::connect(address).is_err() {
        assert!(Instant::now() < end, "nobody listens at {address}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Every page that the README names is there.
#[test]
fn every_link_leads_somewhere() {
    let text = std::fs::read_to_string(project("README.md")).unwrap();
    let mut found = 0;
    for part in text.split("](").skip(1) {
        let target = part.split(')').next().unwrap();
        assert!(
            Path::new(&project(target)).exists(),
            "{target} is not there"
        );
        found += 1;
    }
    assert!(found >= 10, "{found} links");
}
