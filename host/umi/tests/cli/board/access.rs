//! Whose board it is: `umi access`, `umi wipe`, `--key`, by the codes and the exit statuses that
//! programs rest on.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Stdio};

use serde_json::Value;

use crate::rig::run::{Folder, Ran, command, umi, umi_with};

/// A board in a process of its own, its state and keys of people in a folder, and the port of this
/// start.
pub(super) struct Rig {
    pub folder: Folder,
    /// What `umi virtual` is told besides.
    pub more: Vec<String>,
    board: Option<Child>,
    pub port: String,
    /// Where the control says something.
    pub cnc: String,
}

impl Drop for Rig {
    fn drop(&mut self) {
        self.stop();
    }
}

impl Rig {
    pub fn new(is_closed: bool) -> Self {
        let folder = Folder::new();
        for name in ["anna", "ben", "olga", "eve"] {
            umi(&["key", "new", &folder.path(name), "--no-passphrase"]).exits(0);
        }
        let mut rig = Self {
            folder,
            more: Vec::new(),
            board: None,
            port: String::new(),
            cnc: String::new(),
        };
        rig.start(is_closed);
        rig
    }

    /// The power goes.
    pub fn stop(&mut self) {
        if let Some(mut board) = self.board.take() {
            board.kill().unwrap();
            board.wait().unwrap();
        }
    }

    /// A board of Anna, with Ben as engineer and Olga as operator.
    pub fn claimed() -> Self {
        let rig = Self::new(true);
        rig.enrol("anna", "owner", &[]).exits(0);
        let anna = rig.folder.path("anna");
        for (name, role) in [("ben", "engineer"), ("olga", "operator")] {
            rig.enrol(name, role, &["--name", name, "--key", &anna])
                .exits(0);
        }
        rig
    }

    /// The power goes and comes back, with the jumper like this.
    pub fn start(&mut self, is_closed: bool) {
        self.stop();
        let state = self.folder.path("state");
        let jumper = if is_closed { "closed" } else { "open" };
        let mut args = vec!["virtual", "--json", "--usb", "tcp:0", "--cnc", "tcp:0"];
        args.extend(["--state", &state, "--jumper", jumper]);
        args.extend(self.more.iter().map(String::as_str));
        let mut board = command(&args).stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        let mut told = BufReader::new(board.stdout.take().unwrap());
        told.read_line(&mut line).unwrap();
        let told: Value = serde_json::from_str(&line).unwrap();
        self.port = told["usb"].as_str().unwrap().to_owned();
        self.cnc = told["cnc"].as_str().unwrap().to_owned();
        self.board = Some(board);
    }

    pub fn enrol(&self, name: &str, role: &str, more: &[&str]) -> Ran {
        let file = self.folder.path(&format!("{name}.pub"));
        let mut args = vec!["access", "enrol", &file, "--role", role];
        args.extend(more);
        self.run(&args)
    }

    pub fn run(&self, args: &[&str]) -> Ran {
        let mut all = args.to_vec();
        all.extend(["--json", "--port", &self.port]);
        umi(&all)
    }

    /// With somebody's key.
    pub fn as_of(&self, name: &str, args: &[&str]) -> Ran {
        let mut all = args.to_vec();
        let key = self.folder.path(name);
        all.extend(["--key", &key]);
        self.run(&all)
    }

    fn id(&self, name: &str) -> String {
        let shown = umi(&[
            "key",
            "show",
            &self.folder.path(&format!("{name}.pub")),
            "--json",
        ]);
        shown.json()["key_id"].as_str().unwrap().to_owned()
    }

    /// The journal's entries of a type.
    pub fn entries(&self, name: &str, kind: &str) -> Vec<Value> {
        let listed = self.as_of(name, &["log"]).exits(0).json_lines();
        listed.into_iter().filter(|of| of["type"] == kind).collect()
    }
}

pub(super) fn code(ran: Ran) -> String {
    let error = ran.exits(2).json()["error"].clone();
    error["code"].as_str().unwrap().to_owned()
}

const JOB: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../examples/three-spheres.toml"
);

/// The first owner needs the jumper, at the start and no key; everybody else needs the owner.
#[test]
fn the_first_owner_needs_the_jumper() {
    let mut rig = Rig::new(false);
    let shown = rig.run(&["access", "show"]).exits(0).json();
    assert_eq!(shown["mode"], "open");
    assert_eq!(shown["jumper"], false);
    assert_eq!(shown["keys"], serde_json::json!([]));
    assert_eq!(shown["board_key"]["public"].as_str().unwrap().len(), 64);
    assert_eq!(code(rig.enrol("anna", "owner", &[])), "jumper_open");
    rig.start(true);
    assert_eq!(code(rig.enrol("ben", "engineer", &[])), "key_needed");
    let anna = rig
        .enrol("anna", "owner", &["--name", "Anna"])
        .exits(0)
        .json();
    assert_eq!(anna["role"], "owner");
    // The jumper is still closed, and no key any more.
    assert_eq!(code(rig.enrol("eve", "owner", &[])), "key_needed");
    let info = rig.run(&["info"]).exits(0).json();
    assert_eq!(info["access"]["mode"], "claimed");
    assert!(
        rig.run(&["access", "show"])
            .exits(0)
            .json()
            .get("keys")
            .is_none()
    );
    let shown = rig.as_of("anna", &["access", "show"]).exits(0).json();
    assert_eq!(shown["keys"][0]["key_id"], anna["key_id"]);
    assert_eq!(shown["keys"][0]["name"], "Anna");
}

/// Each role does what it is for, and is refused the rest by name; what was done says by whom.
#[test]
fn each_role_does_what_it_is_for() {
    let rig = Rig::claimed();
    let needed = rig.run(&["job", "set", JOB]).exits(2).json();
    assert_eq!(needed["error"]["code"], "key_needed");
    assert_eq!(needed["error"]["needs"], "engineer");
    let low = rig.as_of("olga", &["job", "set", JOB]).exits(2).json();
    assert_eq!(low["error"]["code"], "role_too_low");
    assert_eq!(low["error"]["needs"], "engineer");
    assert_eq!(low["error"]["has"], "operator");
    rig.as_of("ben", &["job", "set", JOB]).exits(0);
    let set = rig.entries("olga", "job_set");
    assert_eq!(set[0]["key_id"], Value::from(rig.id("ben")));
    let ceiling = ["config", "set", "ceilings.rms_mm", "0.5"];
    assert_eq!(code(rig.as_of("ben", &ceiling)), "role_too_low");
    // By the environment, too.
    let anna = rig.folder.path("anna");
    let mut by_name = ceiling.to_vec();
    by_name.extend(["--json", "--port", &rig.port]);
    umi_with(("UMI_KEY", &anna), &by_name).exits(0);
    for name in ["olga", "ben", "anna"] {
        rig.as_of(name, &["job", "show"]).exits(0);
        rig.as_of(name, &["program", "list"]).exits(0);
    }
    assert_eq!(code(rig.run(&["log"])), "key_needed");
    let access = rig.entries("olga", "access");
    assert_eq!(access.len(), 3);
    assert_eq!(access[0]["what"], "enrolled");
    assert_eq!(access[0]["role"], "owner");
    assert!(access[0]["by"].is_null());
    assert_eq!(access[1]["by"], Value::from(rig.id("anna")));
}

/// A wrong key is refused, slowed and journaled, and keeps no right one waiting.
#[test]
fn a_wrong_key_is_slowed() {
    let mut rig = Rig::claimed();
    assert_eq!(code(rig.as_of("eve", &["job", "show"])), "key_unknown");
    let slowed = rig.as_of("eve", &["job", "show"]).exits(2).json();
    assert_eq!(slowed["error"]["code"], "too_many_tries");
    assert!(slowed["error"]["retry_in_s"].as_u64().unwrap() >= 1);
    let shown = rig.run(&["access", "show"]).exits(0).json();
    assert!(shown["retry_in_s"].as_u64().unwrap() >= 1);
    rig.as_of("ben", &["job", "show"]).exits(0);
    for _ in 0..3 {
        rig.as_of("eve", &["job", "show"]).exits(2);
    }
    let refused = rig.entries("olga", "access_refused");
    let unknown: Vec<_> = refused
        .iter()
        .filter(|of| of["why"] == "key_unknown")
        .collect();
    assert_eq!(unknown.len(), 1, "one a minute: {refused:?}");
    assert_eq!(unknown[0]["key_id"], Value::from(rig.id("eve")));
    rig.as_of("eve", &["job", "show"]).exits(2);
    rig.start(false);
    assert!(
        rig.run(&["access", "show"]).exits(0).json()["retry_in_s"]
            .as_u64()
            .unwrap()
            >= 1
    );
    rig.as_of("anna", &["job", "show"]).exits(0);
    // A secret key that is none.
    let public = rig.folder.path("anna.pub");
    let ran = rig.run(&["info", "--key", &public]).exits(1).json();
    assert_eq!(ran["error"]["code"], "not_a_key");
}

/// A locked board reads to operators and changes nothing; who was revoked is a stranger; the last
/// owner stays; all of it over a restart.
#[test]
fn lock_and_revocation_last() {
    let mut rig = Rig::claimed();
    assert_eq!(code(rig.as_of("ben", &["access", "lock"])), "role_too_low");
    let locked = rig.as_of("anna", &["access", "lock"]).exits(0).json();
    assert_eq!(locked["mode"], "locked");
    rig.start(false);
    for name in ["ben", "anna"] {
        assert_eq!(code(rig.as_of(name, &["job", "set", JOB])), "locked");
    }
    rig.as_of("olga", &["job", "show"]).exits(0);
    rig.as_of("olga", &["log"]).exits(0);
    assert_eq!(code(rig.run(&["log"])), "key_needed");
    assert_eq!(
        code(rig.as_of("ben", &["access", "unlock"])),
        "role_too_low"
    );
    rig.as_of("anna", &["access", "unlock"]).exits(0);
    rig.as_of("ben", &["job", "set", JOB]).exits(0);
    let (anna, ben) = (rig.id("anna"), rig.id("ben"));
    assert_eq!(
        code(rig.as_of("anna", &["access", "revoke", &anna])),
        "last_owner"
    );
    rig.as_of("anna", &["access", "revoke", &ben]).exits(0);
    assert_eq!(
        code(rig.as_of("anna", &["access", "revoke", &ben])),
        "key_unknown"
    );
    // Who has the owner's key and mistypes is no stranger.
    assert!(
        rig.entries("olga", "access_refused")
            .iter()
            .all(|of| of["why"] != "key_unknown")
    );
    rig.start(false);
    assert_eq!(code(rig.as_of("ben", &["job", "show"])), "key_unknown");
    let whats: Vec<_> = rig
        .entries("olga", "access")
        .iter()
        .map(|of| of["what"].clone())
        .collect();
    assert_eq!(whats[3..], ["locked", "unlocked", "revoked"]);
}

/// A memory of the keys that was erased leaves a board locked, not open, and so it stays.
#[test]
fn erased_keys_open_no_board() {
    let mut rig = Rig::claimed();
    rig.stop();
    let keys = std::path::PathBuf::from(rig.folder.path("state")).join("access.flash");
    let size = std::fs::read(&keys).unwrap().len();
    std::fs::write(&keys, vec![0xFF; size]).unwrap();
    for _ in 0..2 {
        rig.start(false);
        let shown = rig.run(&["access", "show"]).exits(0).json();
        assert_eq!(shown["mode"], "locked");
        assert_eq!(code(rig.run(&["job", "set", JOB])), "locked");
        rig.as_of("anna", &["job", "set", JOB]).exits(2);
    }
}

/// A wipe needs jumper and owner's key, or the jumper over two starts; what it leaves is a signed
/// record, and a board that is open.
#[test]
fn a_wipe_leaves_a_signed_record() {
    let mut rig = Rig::claimed();
    let wipe = ["wipe", "--yes"];
    rig.run(&["wipe"]).exits(1);
    rig.start(false);
    assert_eq!(code(rig.as_of("anna", &wipe)), "jumper_open");
    assert_eq!(code(rig.run(&wipe)), "key_needed");
    rig.start(true);
    assert_eq!(code(rig.run(&wipe)), "key_needed");
    assert_eq!(code(rig.as_of("ben", &wipe)), "role_too_low");
    rig.as_of("ben", &["job", "set", JOB]).exits(0);
    let before = rig.as_of("olga", &["log", "head"]).exits(0).json();
    rig.as_of("anna", &wipe).exits(0);
    let shown = rig.run(&["access", "show"]).exits(0).json();
    assert_eq!(shown["mode"], "open");
    let file = rig.folder.path("after.umij");
    let pulled = rig.run(&["log", "pull", &file]).exits(0).json();
    assert_eq!(pulled["signed"], true);
    assert_eq!(pulled["key_id"], before["key_id"], "the board's key stays");
    let listed = rig.run(&["log"]).exits(0).json_lines();
    let wiped = listed.iter().find(|of| of["type"] == "wiped").unwrap();
    assert_eq!(wiped["key_id"], Value::from(rig.id("anna")));
    assert!(wiped["next_seq"].as_u64() >= before["seq"].as_u64());
    let shown = rig.run(&["job", "show"]).exits(0).json();
    assert!(shown["job"].is_null());

    // Claimed again, and the key is lost: the jumper at two starts.
    rig.enrol("eve", "owner", &[]).exits(0);
    rig.start(false);
    rig.start(true);
    assert_eq!(code(rig.run(&wipe)), "key_needed");
    rig.start(true);
    rig.run(&wipe).exits(0);
    assert_eq!(rig.run(&["access", "show"]).exits(0).json()["mode"], "open");
}

/// Damages a memory of a board that is off: this bit of each sector's header.
fn damage(rig: &Rig, name: &str) {
    let path = std::path::PathBuf::from(rig.folder.path("state")).join(name);
    let mut cells = std::fs::read(&path).unwrap();
    for sector in cells.chunks_mut(4096) {
        sector[44] ^= 4;
    }
    std::fs::write(&path, cells).unwrap();
}

/// Keys whose memory cannot be read any more: the board is locked, and the jumper held over two starts has it wiped.
#[test]
fn the_jumper_wipes_a_board_of_damaged_keys() {
    let mut rig = Rig::claimed();
    rig.stop();
    for memory in ["access.flash", "custody.flash"] {
        damage(&rig, memory);
    }
    rig.start(true);
    let shown = rig.run(&["access", "show"]).exits(0).json();
    assert_eq!(shown["mode"], "locked");
    rig.as_of("anna", &["job", "set", JOB]).exits(2);
    assert_eq!(code(rig.run(&["wipe", "--yes"])), "locked");
    rig.start(true);
    let wiped = rig.run(&["wipe", "--yes"]).exits(0).json();
    assert_eq!(wiped["mode"], "open");
    assert_eq!(wiped["new_board_key"], Value::Null);
    let listed = rig.run(&["log"]).exits(0).json_lines();
    assert!(listed.iter().any(|of| of["type"] == "wiped"));
    rig.enrol("eve", "owner", &[]).exits(0);
}

/// A board whose own key cannot be read says so, and is not taken for one that is open. The wipe by the jumper draws another,
/// which is told.
#[test]
fn a_wipe_draws_a_key_where_it_cannot_be_read() {
    let mut rig = Rig::claimed();
    let before = rig.as_of("olga", &["log", "head"]).exits(0).json();
    rig.stop();
    damage(&rig, "key.flash");
    rig.start(false);
    let shown = rig.run(&["access", "show"]).exits(0).json();
    assert_eq!(shown["mode"], "claimed");
    let refused = rig.as_of("anna", &["job", "show"]).exits(1).json();
    assert_eq!(refused["error"]["code"], "not_on_this_board");
    let message = refused["error"]["message"].as_str().unwrap();
    assert!(message.contains("umi wipe"), "{message}");
    assert_eq!(code(rig.run(&["wipe", "--yes"])), "key_needed");
    rig.start(true);
    assert_eq!(code(rig.run(&["wipe", "--yes"])), "key_needed");
    rig.start(true);
    let wiped = rig.run(&["wipe", "--yes"]).exits(0).json();
    assert_eq!(wiped["mode"], "open");
    let after = rig.run(&["log", "head"]).exits(0).json();
    assert_eq!(wiped["new_board_key"], after["key_id"]);
    assert_ne!(before["key_id"], after["key_id"]);
    let listed = rig.run(&["log"]).exits(0).json_lines();
    assert!(listed.iter().any(|of| of["type"] == "wiped"));
    rig.enrol("eve", "owner", &[]).exits(0);
    rig.as_of("eve", &["job", "set", JOB]).exits(0);
}

/// Who pulls says the time, once a minute at most.
#[test]
fn a_pull_says_the_time() {
    let rig = Rig::claimed();
    for name in ["one.umij", "two.umij"] {
        let file = rig.folder.path(name);
        rig.as_of("olga", &["log", "pull", &file]).exits(0);
    }
    let told = rig.entries("olga", "host_time");
    assert_eq!(told.len(), 1);
    assert_eq!(told[0]["key_id"], rig.id("olga"));
    let now = std::time::SystemTime::now();
    let now = now.duration_since(std::time::UNIX_EPOCH).unwrap().as_secs();
    let of = told[0]["utc_s"].as_u64().unwrap();
    assert!((of..of + 600).contains(&now));
    assert!(told[0]["utc"].as_str().unwrap().ends_with('Z'));
}
