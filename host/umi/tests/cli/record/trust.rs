//! Whether a record convinces somebody who was not there: `umi log pull|verify|head|export`,
//! `umi access board-key`, `umi key`; each forgery of a journal, and its name.

use std::sync::Arc;
use std::time::Duration;

use serde_json::Value;
use umi_core::journal::{Entry, FILE_HEADER_SIZE, FileHeader, OVERHEAD, decode_file, encode_entry};
use umi_protocol::message::Record;
use umi_virtual::serve::{Port, PortPlace};
use umi_virtual::{BoardTime, Config, KEY, VirtualBoard, VirtualFlash};

use crate::rig::board::Board;
use crate::rig::run::{Folder, Ran, umi};

/// A board with a key, in this memory.
fn config() -> Config {
    Config {
        time: BoardTime::Real,
        key: Some(VirtualFlash::in_memory(KEY)),
        ..Config::default()
    }
}

/// The board at work, and its address.
fn start(config: &Config) -> (Arc<VirtualBoard>, String) {
    let board = Arc::new(VirtualBoard::start(config.clone()).unwrap());
    let port = Port::open(&PortPlace::Tcp(0)).unwrap();
    let address = port.address.clone();
    port.serve_host(&board);
    (board, address)
}

/// Some lines of a control.
fn talk(board: &VirtualBoard, lines: usize) {
    for line in 0..lines {
        board.control_sends(format!("POINT {line}: -135.5105 -136.3415 72.0620\r\n").as_bytes());
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn error(ran: Ran) -> Value {
    ran.exits(2).json()["error"].clone()
}

fn names(value: &Value) -> Vec<&str> {
    value
        .as_object()
        .unwrap()
        .keys()
        .map(String::as_str)
        .collect()
}

/// Kind, time and payload of each entry.
type Entries = Vec<(u8, u64, Vec<u8>)>;

/// The entries of a file as somebody without the key can write them: changed, with check values
/// and chain made anew.
fn forged(file: &[u8], change: impl FnOnce(&mut Entries)) -> Vec<u8> {
    let (header, entries) = decode_file(file).unwrap();
    let mut all: Vec<_> = entries
        .map(|entry| entry.unwrap())
        .map(|entry| (entry.kind, entry.t.0, entry.payload.to_vec()))
        .collect();
    change(&mut all);
    let mut out = header.encode().to_vec();
    let mut chain = header.chain_before;
    for (seq, (kind, t_us, payload)) in (header.first_seq..).zip(&all) {
        let entry = Entry {
            seq,
            t: umi_core::units::Micros(*t_us),
            kind: *kind,
            payload,
        };
        let mut room = vec![0; payload.len() + OVERHEAD];
        encode_entry(&entry, &mut chain, &mut room).unwrap();
        out.extend(room);
    }
    out
}

/// A pulled journal is signed to its end, and says by whom; a head that was kept holds later.
#[test]
fn a_pulled_journal_is_the_boards_word() {
    let (folder, config) = (Folder::new(), config());
    let (board, port) = start(&config);
    talk(&board, 20);
    let (key, file, head) = (
        folder.path("board.pub"),
        folder.path("a.umij"),
        folder.path("a.head"),
    );
    let shown = umi(&["access", "board-key", "-o", &key, "--json", "--port", &port]);
    let shown = shown.exits(0).json();
    let kept = umi(&["log", "head", "-o", &head, "--json", "--port", &port]);
    let kept = kept.exits(0).json();
    for name in [
        "seq",
        "chain",
        "boot",
        "serial",
        "key_id",
        "nonce",
        "signature",
    ] {
        assert!(kept.get(name).is_some(), "{name} in {kept}");
    }
    assert_eq!(kept["boot"], 1);
    assert_eq!(kept["key_id"], shown["key_id"]);
    let pulled = umi(&["log", "pull", &file, "--json", "--port", &port]);
    let pulled = pulled.exits(0).json();
    assert_eq!(
        names(&pulled),
        [
            "type",
            "first_seq",
            "next_seq",
            "chain",
            "file",
            "signed",
            "signed_to",
            "ended",
            "entries",
            "key_id",
            "overwritten"
        ]
    );
    let verify = ["log", "verify", &file, "--json"];
    let with_key = [&verify[..], &["--key", &key, "--after", &head]].concat();
    for args in [&verify[..], &with_key] {
        let verified = umi(args).exits(0).json();
        assert_eq!(verified, pulled);
        assert_eq!(verified["signed"], true);
        assert_eq!(verified["key_id"], shown["key_id"]);
        assert_eq!(verified["overwritten"], Value::Array(Vec::new()));
    }
    let listed = umi(&["log", &file, "--json"]).exits(0).json_lines();
    assert_eq!(listed[listed.len() - 2]["type"], "head");
    assert!(
        umi(&["log", &file])
            .exits(0)
            .out
            .contains("signed by board key")
    );
    umi(&["replay", &file]).exits(0);

    // After a restart it goes on, and the board has counted it.
    drop(board);
    std::thread::sleep(Duration::from_millis(50));
    let (_board, port) = start(&config);
    let later = folder.path("b.umij");
    umi(&["log", "-o", &later, "--port", &port]).exits(0);
    let args = ["log", "verify", &later, "--key", &key, "--after", &head];
    umi(&args).exits(0);
    let head = umi(&["log", "head", "--json", "--port", &port]);
    assert_eq!(head.exits(0).json()["boot"], 2);
}

/// Edited, dropped, put in, cut, of another board, an older memory put back: each by its name,
/// with the first wrong entry, and neither listed nor replayed as good.
#[test]
fn forged_journals_are_refused() {
    let (folder, config) = (Folder::new(), config());
    let older = {
        let (board, _) = start(&config);
        talk(&board, 3);
        std::thread::sleep(Duration::from_millis(500));
        drop(board);
        std::thread::sleep(Duration::from_millis(50));
        (
            copied(&config.journal),
            config.evidence.as_ref().map(copied),
        )
    };
    let (board, port) = start(&config);
    talk(&board, 20);
    let (key, file, head) = (
        folder.path("board.pub"),
        folder.path("a.umij"),
        folder.path("a.head"),
    );
    umi(&["access", "board-key", "-o", &key, "--port", &port]).exits(0);
    umi(&["log", "pull", &file, "--port", &port]).exits(0);
    umi(&["log", "head", "-o", &head, "--port", &port]).exits(0);
    let honest = std::fs::read(&file).unwrap();
    type Forgery = fn(&mut Entries);
    let forgeries: [Forgery; 4] = [
        |all| drop(all.remove(1)),
        |all| all[1].1 += 1,
        |all| all.swap(1, 2),
        |all| all.insert(1, all[1].clone()),
    ];
    for forgery in forgeries {
        let bad = folder.file("forged.umij", forged(&honest, forgery));
        let with_key: &[&str] = &["log", "verify", &bad, "--key", &key, "--json"];
        for args in [with_key, &["log", "verify", &bad, "--json"]] {
            let error = error(umi(args));
            assert_eq!(error["code"], "head_signature", "{error}");
            assert!(error["seq"].is_u64(), "{error}");
        }
        umi(&["log", &bad]).exits(2);
        umi(&["replay", &bad]).exits(2);
        let out = folder.path("forged.csv");
        umi(&["log", "export", &bad, "--format", "csv", "-o", &out]).exits(2);
    }
    // Without heads it is a file that nobody vouches for, and says so.
    let bare = folder.file("bare.umij", {
        let file = forged(&honest, |all| all.retain(|entry| entry.0 != 24));
        let (header, _) = FileHeader::decode(&file).unwrap();
        let header = FileHeader {
            nonce: None,
            ..header
        };
        [&header.encode()[..], &file[FILE_HEADER_SIZE..]].concat()
    });
    assert_eq!(
        error(umi(&["log", "verify", &bare, "--key", &key, "--json"]))["code"],
        "head_missing"
    );
    let told = umi(&["log", "verify", &bare, "--json"]).exits(0).json();
    assert_eq!(
        (&told["signed"], &told["signed_to"]),
        (&Value::Bool(false), &Value::Null)
    );
    assert!(umi(&["log", &bare]).exits(0).out.contains("unsigned"));
    // Cut at an entry, and inside of one; a flipped bit; a header of zeros.
    let (_, mut entries) = decode_file(&honest).unwrap();
    entries.next().unwrap().unwrap();
    let first = FILE_HEADER_SIZE + entries.offset();
    let mut flipped = honest.clone();
    flipped[first + 22] ^= 0x10;
    let mut headless = honest.clone();
    headless[30] ^= 1;
    for (bytes, code, seq) in [
        (&honest[..first], "head_missing", Value::from(0)),
        (&honest[..first + 9], "entry_cut_short", Value::from(1)),
        (&flipped, "entry_damaged", Value::from(1)),
        (&headless, "journal_header_damaged", Value::Null),
        (&honest[..0], "journal_header_damaged", Value::Null),
        (&honest[..3], "journal_header_damaged", Value::Null),
    ] {
        let bad = folder.file("bad.umij", bytes);
        let error = error(umi(&["log", "verify", &bad, "--key", &key, "--json"]));
        assert_eq!((&error["code"], &error["seq"]), (&Value::from(code), &seq));
    }
    // Another board's file.
    let (_other, other_port) = start(&self::config());
    let other = folder.path("other.umij");
    umi(&["log", "pull", &other, "--port", &other_port]).exits(0);
    let told = error(umi(&["log", "verify", &other, "--key", &key, "--json"]));
    assert_eq!(told["code"], "head_other_board");
    // The journal of last week in the board, and the evidence of today: what is missing between them ends the pull.
    drop(board);
    std::thread::sleep(Duration::from_millis(50));
    let back = folder.path("back.umij");
    if config.evidence.is_some() {
        let half = Config {
            journal: copied(&older.0),
            evidence: config.evidence.as_ref().map(copied),
            ..config.clone()
        };
        let (half, port) = start(&half);
        let told = error(umi(&["log", "pull", &back, "--json", "--port", &port]));
        let codes = ["entry_damaged", "entries_missing"].map(Value::from);
        assert!(codes.contains(&told["code"]), "{told}");
        let from = told["readable_from"].as_u64().unwrap().to_string();
        umi(&[
            "log", "pull", &back, "--from", &from, "--force", "--port", &port,
        ])
        .exits(0);
        let args = [
            "log", "verify", &back, "--key", &key, "--after", &head, "--json",
        ];
        assert_eq!(error(umi(&args))["code"], "head_not_shown");
        drop(half);
        std::thread::sleep(Duration::from_millis(50));
        std::fs::remove_file(&back).unwrap();
    }
    // Both of last week: the board signs what it has, and the kept head tells.
    let rolled = Config {
        journal: older.0,
        evidence: older.1,
        ..config
    };
    let (again, port) = start(&rolled);
    umi(&["log", "pull", &back, "--port", &port]).exits(0);
    umi(&["log", "verify", &back, "--key", &key]).exits(0);
    let args = [
        "log", "verify", &back, "--key", &key, "--after", &head, "--json",
    ];
    assert_eq!(error(umi(&args))["code"], "head_older");
    // It has gone on for longer than the kept head reaches, and the file begins behind its place.
    talk(&again, 30);
    let place = umi(&["log", "head", "--json", "--port", &port])
        .exits(0)
        .json()["seq"]
        .to_string();
    umi(&[
        "log", "pull", &back, "--from", &place, "--force", "--port", &port,
    ])
    .exits(0);
    assert_eq!(error(umi(&args))["code"], "head_not_shown");
}

/// A correction is made by a journal only if a head of the board stands behind the verdict, and its inputs come to it: a
/// verdict that was changed, a file without heads, another board's. Who says `--unsigned` takes the file's word.
#[test]
fn a_forged_verdict_corrects_nothing() {
    const VERDICT: u8 = 10;
    const HEAD: u8 = 24;
    let (folder, config) = (Folder::new(), config());
    let (board, port) = start(&config);
    let job = folder.file(
        "j.toml",
        include_str!("../../../../../examples/three-spheres.toml"),
    );
    umi(&["job", "set", &job, "--port", &port]).exits(0);
    let session = include_str!("../../../../../examples/session.txt");
    let two: String = session.split_inclusive('\n').take(54).collect();
    board.control_sends(two.as_bytes());
    let judged = || umi(&["info", "--json", "--port", &port]).json()["status"]["verdicts"] == 2;
    while !judged() {
        std::thread::sleep(Duration::from_millis(20));
    }
    let (key, other, file) = (
        folder.path("board.pub"),
        folder.path("other.pub"),
        folder.path("a.umij"),
    );
    umi(&["access", "board-key", "-o", &key, "--port", &port]).exits(0);
    let (_other, elsewhere) = start(&self::config());
    umi(&["access", "board-key", "-o", &other, "--port", &elsewhere]).exits(0);
    umi(&["log", "pull", &file, "--port", &port]).exits(0);
    let by = |file: &str, more: &[&str]| {
        umi(&[&["correction", "--json", "--verdict", file], more].concat())
    };
    let made = by(&file, &[]).exits(0).out;
    assert_eq!(by(&file, &["--board-key", &key]).exits(0).out, made);
    assert_eq!(
        error(by(&file, &["--board-key", &other]))["code"],
        "head_other_board"
    );
    let honest = std::fs::read(&file).unwrap();
    let moved = |all: &mut Entries| {
        let last = all.iter_mut().rfind(|entry| entry.0 == VERDICT).unwrap();
        let Ok(Record::Verdict(mut verdict)) = postcard::from_bytes(&last.2) else {
            panic!("no verdict");
        };
        verdict.registration.as_mut().unwrap().translation_mm[0] += 10.0;
        let mut room = [0; umi_protocol::message::MAX_RECORD];
        let record = Record::Verdict(verdict);
        last.2 = postcard::to_slice(&record, &mut room).unwrap().to_vec();
    };
    let changed = folder.file("changed.umij", forged(&honest, moved));
    assert_eq!(error(by(&changed, &[]))["code"], "head_signature");
    let bare = |change: &dyn Fn(&mut Entries)| {
        let file = forged(&honest, |all| {
            all.retain(|entry| entry.0 != HEAD);
            change(all);
        });
        let (header, _) = FileHeader::decode(&file).unwrap();
        let header = FileHeader {
            nonce: None,
            ..header
        };
        [&header.encode()[..], &file[FILE_HEADER_SIZE..]].concat()
    };
    let (stripped, made_up) = (
        folder.file("bare.umij", bare(&|_| {})),
        folder.file("made.umij", bare(&moved)),
    );
    for file in [&stripped, &made_up] {
        assert_eq!(error(by(file, &[]))["code"], "unsigned");
        by(file, &["--unsigned"]).exits(0);
    }
    assert_eq!(by(&stripped, &["--unsigned"]).out, made);
    let replayed = umi(&["replay", &stripped]).exits(0).out;
    assert!(replayed.contains("unsigned"), "{replayed}");
    umi(&["replay", &made_up]).exits(2);
    let program = crate::rig::run::project("examples/part.nc");
    let rewrite = ["nc", "rewrite", &program, "-o", "-", "--verdict", &changed];
    umi(&rewrite).exits(2).says("signature");
}

/// A file whose end is not signed over the puller's number says so: what the board wrote behind its last head can have been
/// left out. What an impostor's pull has left under the name does not stand in the way of an honest one.
#[test]
fn an_end_that_was_not_signed_is_told() {
    let (folder, config) = (Folder::new(), config());
    let (board, port) = start(&config);
    talk(&board, 5);
    let (_other, elsewhere) = start(&self::config());
    let (file, foreign) = (folder.path("a.umij"), folder.path("foreign.umij"));
    umi(&["log", "pull", &foreign, "--port", &elsewhere]).exits(0);
    let open_end = |path: &str| {
        let bytes = std::fs::read(path).unwrap();
        let (header, _) = FileHeader::decode(&bytes).unwrap();
        let header = FileHeader {
            nonce: None,
            ..header
        };
        [&header.encode()[..], &bytes[FILE_HEADER_SIZE..]].concat()
    };
    folder.file("a.umij.part", open_end(&foreign));
    let pulled = umi(&["log", "pull", &file, "--json", "--port", &port]);
    let pulled = pulled.exits(0).json();
    assert_eq!(
        (&pulled["signed"], &pulled["ended"]),
        (&true.into(), &true.into())
    );
    assert_eq!(pulled["entries"], pulled["next_seq"]);
    let open = folder.file("open.umij", open_end(&file));
    let told = umi(&["log", "verify", &open, "--json"]).exits(0).json();
    assert_eq!(
        (&told["signed"], &told["ended"]),
        (&true.into(), &false.into())
    );
    let told = umi(&["log", "verify", &open]).exits(0).out;
    assert!(told.contains("can have been left out"), "{told}");
    assert!(told.contains("not held against a board key"), "{told}");
}

/// The cells of a flash as they are now.
fn copied(flash: &VirtualFlash) -> VirtualFlash {
    use umi_core::journal::Flash as _;
    let (mut from, geometry) = (flash.clone(), flash.geometry());
    let mut to = VirtualFlash::in_memory(geometry);
    let mut bytes = vec![0; 4096];
    for at in (0..u32::from(geometry.sectors) * geometry.sector_size).step_by(bytes.len()) {
        from.read(at, &mut bytes).unwrap();
        if bytes.iter().any(|byte| *byte != 0xFF) {
            to.program(at, &bytes).unwrap();
        }
    }
    to
}

/// A pull that broke off goes on from what is there; what is of another board is not gone on with.
#[test]
fn a_pull_goes_on_where_it_broke_off() {
    let folder = Folder::new();
    let (board, port) = start(&config());
    talk(&board, 20);
    let (whole, file) = (folder.path("whole.umij"), folder.path("a.umij"));
    umi(&["log", "pull", &whole, "--port", &port]).exits(0);
    let honest = std::fs::read(&whole).unwrap();
    let (header, mut entries) = decode_file(&honest).unwrap();
    for _ in 0..5 {
        entries.next().unwrap().unwrap();
    }
    let header = FileHeader {
        nonce: None,
        ..header
    };
    // Five entries and a half.
    let end = FILE_HEADER_SIZE + entries.offset() + 20;
    let part = [&header.encode()[..], &honest[FILE_HEADER_SIZE..end]].concat();
    std::fs::write(format!("{file}.part"), &part).unwrap();
    let pulled = umi(&["log", "pull", &file, "--json", "--port", &port]).exits(0);
    assert_eq!(pulled.json()["signed"], true);
    let now = std::fs::read(&file).unwrap();
    assert_eq!(
        now[FILE_HEADER_SIZE..honest.len()],
        honest[FILE_HEADER_SIZE..]
    );

    let (_other, other) = start(&config());
    let next = folder.path("b.umij");
    std::fs::write(format!("{next}.part"), &part).unwrap();
    let told = umi(&["log", "pull", &next, "--json", "--port", &other]);
    assert_eq!(error(told)["code"], "other_journal");
}

/// A board without a key says so; its journal is pulled, unsigned.
#[test]
fn a_board_without_a_key_says_so() {
    let (folder, port) = (Folder::new(), Board::new(0).serve());
    for args in [["log", "head"], ["access", "board-key"]] {
        let told = umi(&[&args[..], &["--json", "--port", &port]].concat());
        assert_eq!(error(told)["code"], "no_board_key");
    }
    let shown = umi(&["access", "show", "--json", "--port", &port])
        .exits(0)
        .json();
    assert_eq!(
        (&shown["mode"], &shown["board_key"]),
        (&"open".into(), &Value::Null)
    );
    let file = folder.path("a.umij");
    let pulled = umi(&["log", "pull", &file, "--json", "--port", &port]);
    assert_eq!(pulled.exits(0).json()["signed"], false);
}

/// A board without an owner says that it is open, with the key by which it signs.
#[test]
fn an_open_board_says_so() {
    let (_board, port) = start(&config());
    let key = umi(&["access", "board-key", "--json", "--port", &port])
        .exits(0)
        .json();
    let shown = umi(&["access", "show", "--json", "--port", &port])
        .exits(0)
        .json();
    assert_eq!(shown["mode"], "open");
    assert_eq!(shown["board_key"]["public"], key["public"]);
    assert_eq!(shown["keys"], Value::Array(vec![]));
    let text = umi(&["access", "show", "--port", &port]).exits(0).out;
    assert!(text.contains("whoever reaches the port"), "{text}");
    let info = umi(&["info", "--json", "--port", &port]).exits(0).json();
    assert_eq!(info["access"]["mode"], "open");
}

/// A journal as a table and as lines: one for each entry, and the same records.
#[test]
fn a_journal_is_exported() {
    let (folder, port) = (Folder::new(), Board::new(0).serve());
    let file = folder.path("a.umij");
    umi(&["log", "pull", &file, "--port", &port]).exits(0);
    let (lines, table) = (folder.path("a.jsonl"), folder.path("a.csv"));
    for (format, out) in [("jsonl", &lines), ("csv", &table)] {
        umi(&["log", "export", &file, "--format", format, "-o", out]).exits(0);
        umi(&["log", "export", &file, "--format", format, "-o", out])
            .exits(1)
            .says("is there already");
    }
    let lines = std::fs::read_to_string(lines).unwrap();
    let listed = umi(&["log", &file, "--json"]).exits(0).out;
    let listed: Vec<_> = listed.lines().collect();
    assert_eq!(
        lines.lines().collect::<Vec<_>>(),
        listed[..listed.len() - 1]
    );
    // Nobody vouches for it: that is told.
    let told = umi(&[
        "log", "export", &file, "--format", "csv", "-o", &table, "--json", "--force",
    ])
    .exits(0);
    assert_eq!(told.json()["signed"], false);
    assert!(told.err.contains("not signed to its end"), "{}", told.err);
    let table = std::fs::read_to_string(table).unwrap();
    assert_eq!(table.lines().count(), 6);
    assert!(
        table.starts_with("seq,t_us,type,record\r\n0,0,boot,\"{\"\"seq\"\":0"),
        "{table}"
    );
    let columns = folder.path("a.parquet");
    umi(&[
        "log", "export", &file, "--format", "parquet", "-o", &columns,
    ])
    .exits(0);
    let columns = std::fs::read(columns).unwrap();
    assert!(columns.starts_with(b"PAR1") && columns.ends_with(b"PAR1"));
}

/// A key pair is two files, shown by its short name; nothing is replaced.
#[test]
fn a_key_is_made_once() {
    let folder = Folder::new();
    let file = folder.path("anna");
    let made = umi(&["key", "new", &file, "--no-passphrase", "--json"])
        .exits(0)
        .json();
    assert_eq!(names(&made), ["key_id", "public", "file", "public_file"]);
    assert_eq!(made["public"].as_str().unwrap().len(), 64);
    let shown = umi(&["key", "show", &format!("{file}.pub"), "--json"])
        .exits(0)
        .json();
    assert_eq!(
        (&shown["key_id"], &shown["public"]),
        (&made["key_id"], &made["public"])
    );
    umi(&["key", "new", &file, "--no-passphrase"])
        .exits(1)
        .says("exists");
    umi(&["key", "new", &folder.path("bert")])
        .exits(1)
        .says("--no-passphrase");
    umi(&["key", "show", &file])
        .exits(1)
        .says("no Ed25519 public key");
}
