//! Runs the tool.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};

use serde_json::Value;

/// What a run left behind.
pub struct Ran {
    pub status: i32,
    pub out: String,
    pub err: String,
}

impl Ran {
    /// The only JSON value on standard output.
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.out)
            .unwrap_or_else(|e| panic!("{e}: {:?}, errors {:?}", self.out, self.err))
    }

    /// One JSON value for each line of standard output.
    pub fn json_lines(&self) -> Vec<Value> {
        let lines = self.out.lines();
        lines
            .map(|line| serde_json::from_str(line).unwrap())
            .collect()
    }

    /// Asserts the exit status, and shows all if it is another.
    pub fn exits(self, status: i32) -> Self {
        assert_eq!(self.status, status, "{}\n{}", self.out, self.err);
        self
    }

    /// Asserts that this stands on standard error.
    pub fn says(self, text: &str) -> Self {
        assert!(self.err.contains(text), "no {text:?} in {:?}", self.err);
        self
    }
}

/// `umi` with these arguments, to be run.
pub fn command(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_umi"));
    command
        .args(args)
        .env_remove("UMI_PORT")
        .env_remove("UMI_KEY")
        .env_remove("NO_COLOR");
    command
}

fn ran(output: Output) -> Ran {
    Ran {
        status: output.status.code().unwrap(),
        out: String::from_utf8(output.stdout).unwrap(),
        err: String::from_utf8(output.stderr).unwrap(),
    }
}

/// Runs `umi` with these arguments.
pub fn umi(args: &[&str]) -> Ran {
    ran(command(args).stdin(Stdio::null()).output().unwrap())
}

/// Runs `umi` with an environment variable.
pub fn umi_with(variable: (&str, &str), args: &[&str]) -> Ran {
    let mut command = command(args);
    ran(command
        .env(variable.0, variable.1)
        .stdin(Stdio::null())
        .output()
        .unwrap())
}

/// Runs `umi` and gives it this on standard input.
pub fn umi_reads(input: &[u8], args: &[&str]) -> Ran {
    let mut child = command(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It may end without reading.
    let _ = child.stdin.take().unwrap().write_all(input);
    ran(child.wait_with_output().unwrap())
}

/// A virtual machine that runs a program, as slow as a machine, in front of a virtual
/// board that may be watched. Ends with this value.
pub struct Machine {
    child: std::process::Child,
    /// The port of the board's host.
    pub port: String,
}

impl Machine {
    /// Runs a program on the example's machine.
    pub fn start(folder: &Folder, program: &str) -> Self {
        use std::io::{BufRead as _, BufReader};
        let program = folder.file("live.nc", program);
        let (scene, job) = (
            project("examples/scenes/three-spheres.toml"),
            project("examples/three-spheres-witnessed.toml"),
        );
        let mut child = command(&["machine", "run", &program, "--scene", &scene])
            .args(["--board", "virtual", "--job", &job])
            .args(["--usb", "tcp:0", "--json"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        out.read_line(&mut line).unwrap();
        // Somebody must read the rest.
        std::thread::spawn(move || std::io::copy(&mut out, &mut std::io::sink()));
        let line: Value = serde_json::from_str(&line).unwrap();
        Self {
            child,
            port: line["usb"].as_str().unwrap().to_owned(),
        }
    }
}

/// A machine with a laser line scanner that runs a program; its board's port, its sensor's.
pub struct ScanningMachine {
    child: std::process::Child,
    /// The port of the board's host.
    pub port: String,
    /// The data channel of the sensor, as `tcp:HOST:PORT`.
    pub sensor: String,
}

impl ScanningMachine {
    /// Runs a program on the machine of a scene.
    pub fn start(scene: &str, program: &str) -> Self {
        use std::io::{BufRead as _, BufReader};
        let job = project("examples/three-spheres-witnessed.toml");
        let mut child = command(&["machine", "run", program, "--scene", scene])
            .args(["--board", "virtual", "--job", &job])
            .args(["--usb", "tcp:0", "--scanner", "0", "--json"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut next = || {
            let mut line = String::new();
            out.read_line(&mut line).unwrap();
            let line: Value = serde_json::from_str(&line).unwrap();
            line
        };
        let (board, sensor) = (next(), next());
        // Somebody must read the rest.
        std::thread::spawn(move || std::io::copy(&mut out, &mut std::io::sink()));
        Self {
            child,
            port: board["usb"].as_str().unwrap().to_owned(),
            sensor: format!("tcp:{}", sensor["tcp"].as_str().unwrap()),
        }
    }
}

impl Drop for ScanningMachine {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A folder of its own for one test, removed at its end.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new() -> Self {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let path = Path::new(env!("CARGO_TARGET_TMPDIR"))
            .join(format!("cli-{}-{number}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    /// The path of a file in it.
    pub fn path(&self, name: &str) -> String {
        self.0.join(name).to_str().unwrap().to_owned()
    }

    /// Writes a file into it.
    pub fn file(&self, name: &str, content: impl AsRef<[u8]>) -> String {
        let path = self.path(name);
        std::fs::write(&path, content).unwrap();
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A file of the project.
pub fn project(path: &str) -> String {
    format!("{}/../../{path}", env!("CARGO_MANIFEST_DIR"))
}
