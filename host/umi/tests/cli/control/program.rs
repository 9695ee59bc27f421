//! `umi program`, against a virtual board.

use std::sync::Arc;

use umi_virtual::serve::{Port, PortPlace};
use umi_virtual::{Config, VirtualBoard};

use crate::rig::run::{Folder, umi};

/// A virtual board on a port of this machine: its address.
fn board() -> String {
    let board = Arc::new(VirtualBoard::start(Config::default()).unwrap());
    let port = Port::open(&PortPlace::Tcp(0)).unwrap();
    let address = port.address.clone();
    port.serve_host(&board);
    address
}

/// Put, list, get, delete: what comes back is what was put, byte for byte.
#[test]
fn a_program_comes_back_as_it_was() {
    let (folder, port) = (Folder::new(), board());
    let port = port.as_str();
    let text =
        "%\r\nO0042(POCKET)\r\n".to_owned() + &"G1 X1.5 Y-2.\r\n".repeat(1000) + "M30\r\n%\r\n";
    let file = folder.file("pocket.nc", &text);
    let put = umi(&["program", "put", &file, "--port", port]).exits(0);
    assert!(put.out.contains("O0042 pocket"), "{}", put.out);
    let list = umi(&["program", "list", "--json", "--port", port])
        .exits(0)
        .json();
    let program = &list["programs"][0];
    assert_eq!(program["number"], 42);
    assert_eq!(program["bytes"], text.len());
    assert_eq!(list["room"]["programs"], 1);
    let again = umi(&["program", "put", &file, "--json", "--port", port]);
    assert_eq!(again.exits(0).json()["was_there"], true);
    let back = folder.path("back.nc");
    umi(&["program", "get", "O42", "-o", &back, "--port", port]).exits(0);
    assert_eq!(std::fs::read(&back).unwrap(), text.as_bytes());
    umi(&["program", "get", "42", "-o", &back, "--port", port])
        .exits(1)
        .says("is there already");
    umi(&["program", "delete", "42", "--port", port]).exits(0);
    umi(&["program", "delete", "42", "--port", port])
        .exits(2)
        .says("there is no such program");
}

/// A program without an O line needs a number, one with it none but its own; one that finds
/// no room is refused with figures.
#[test]
fn what_cannot_be_put_is_named() {
    let (folder, port) = (Folder::new(), board());
    let port = port.as_str();
    let file = folder.file("nameless.nc", "%\nG21\nM30\n%\n");
    umi(&["program", "put", &file, "--port", port])
        .exits(1)
        .says("--number");
    umi(&["program", "put", &file, "--number", "O7", "--port", port]).exits(0);
    let other = folder.file("other.nc", "%\nO0042\nM30\n%\n");
    let refused = umi(&["program", "put", &other, "--number", "7", "--port", port]).exits(1);
    refused.says("O0042 by its own O line, not O0007");
    umi(&["program", "pass", &other, "--number", "7", "--port", port]).exits(1);
    umi(&["program", "put", &other, "--number", "42", "--port", port]).exits(0);
    let long = folder.file(
        "long.nc",
        "%\n".to_owned() + &"G1 X1.\n".repeat(700_000) + "%\n",
    );
    let refused = umi(&[
        "program", "put", &long, "--number", "8", "--json", "--port", port,
    ]);
    let error = refused.exits(2).json()["error"].clone();
    assert_eq!(error["code"], "program_store_full");
    assert_eq!(error["needed_bytes"], 4_900_004);
    assert!(error["longest_bytes"].as_u64().unwrap() < 4 << 20);
}

/// What a board would never let out is not put: without % at either end, or with a line that
/// cannot be rewritten, which is named. As it is, that one may go out.
#[test]
fn what_would_never_go_out_is_not_put() {
    let (folder, port) = (Folder::new(), board());
    let port = port.as_str();
    for text in ["O0042\nM30\n%\n", "%\nO0042\nG0 X1.\nG1 Z-"] {
        let bare = folder.file("bare.nc", text);
        let refused = umi(&["program", "put", &bare, "--json", "--port", port]);
        assert_eq!(refused.exits(2).json()["error"]["code"], "no_percent");
    }
    // Only where the part leans: cutter compensation would leave its plane.
    let text = "%\nO0043\nG21 G90 G17\nG0 X0. Y0. Z5.\nG41 D1 G1 X9. F100.\nG40 X0.\nM30\n%\n";
    let file = folder.file("offset.nc", text);
    for action in ["put", "pass"] {
        let arguments = [
            "program",
            action,
            &file,
            "--release",
            "rewritten",
            "--json",
            "--port",
            port,
        ];
        let error = umi(&arguments).exits(2).json()["error"].clone();
        assert_eq!(error["code"], "not_rewritable");
        assert_eq!(
            (&error["line"], &error["column"]),
            (&5.into(), &1.into()),
            "{error}"
        );
        let message = error["message"].as_str().unwrap();
        assert!(message.contains("line 5"), "{message}");
    }
    // What integers count is a setting of the control, not of the program.
    let file_of_integers = folder.file("whole.nc", "%\nO0044\nG21 G90 G0 X10 Y0 Z5\nM30\n%\n");
    let put = |more: &[&str]| {
        let all = [
            "program",
            "put",
            &file_of_integers,
            "--release",
            "rewritten",
            "--port",
            port,
        ];
        umi(&[&all, more].concat())
    };
    put(&[]).exits(2).says("line 3");
    put(&["--integers", "units"]).exits(0);
    let list = umi(&["program", "list", "--json", "--port", port])
        .exits(0)
        .json();
    assert_eq!(list["programs"].as_array().unwrap().len(), 1);
    umi(&["program", "put", &file, "--port", port]).exits(0);
}

/// A board whose job corrects already does not rewrite, and `put` says so at once.
#[test]
fn what_would_correct_twice_is_said() {
    let (folder, port) = (Folder::new(), board());
    let port = port.as_str();
    let file = folder.file(
        "part.nc",
        "%\nO42\nG21 G90 G17 G94\nG0 X0. Y0. Z0.\nM30\n%\n",
    );
    let put = |release: &str| {
        let put = [
            "program",
            "put",
            &file,
            "--release",
            release,
            "--port",
            port,
            "--json",
        ];
        umi(&put).exits(0).json()["withheld"].clone()
    };
    assert!(put("rewritten").is_null());
    let job = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../examples/three-spheres.toml"
    );
    umi(&["job", "set", job, "--port", port]).exits(0);
    assert_eq!(put("rewritten"), "corrected_twice");
    let in_words = [
        "program",
        "put",
        &file,
        "--release",
        "rewritten",
        "--port",
        port,
    ];
    let said = umi(&in_words).exits(0).out;
    assert!(said.contains("say `send = \"never\"` in the job"), "{said}");
    // A job that sends nothing lets it go out, where the program runs in the offset that was probed.
    let text = std::fs::read_to_string(job).unwrap();
    let never = text.replace("send = \"on_request\"", "send = \"never\"");
    assert_ne!(never, text);
    let here = folder.file("n.toml", &never);
    let there = folder.file("m.toml", never.replace("\"G54\"", "\"G57\""));
    for (job, withheld) in [(here, None), (there, Some("not_rewritable"))] {
        umi(&["job", "set", &job, "--port", port]).exits(0);
        assert_eq!(put("rewritten").as_str(), withheld);
    }
}

/// What is said of a program goes with it: what was tried here is what the board rewrites by.
/// What a board cannot keep is refused by name, and so is what says nothing there.
#[test]
fn what_is_said_of_a_program_goes_with_it() {
    let (folder, port) = (Folder::new(), board());
    let port = port.as_str();
    let bare = "%\nO0045\nG0 X0. Y0. Z5.\nG81 X1. Y1. Z-1. R6. F100.\nG80\nM98 P9100\nM30\n%\n";
    let file = folder.file("bare.nc", bare);
    let put = |more: &[&str]| {
        let all = ["program", "put", &file, "--port", port];
        umi(&[&all, more].concat())
    };
    let rewritten = |more: &[&str]| put(&[&["--release", "rewritten"], more].concat());
    // Each is named with the option that says it.
    rewritten(&[]).exits(2).says("--start G");
    let start = ["--start", "G90,G21,G17,G94,G98"];
    rewritten(&start)
        .exits(2)
        .says("--dialect fanuc or linuxcnc");
    let of = |dialect| [&start[..], &["--dialect", dialect]].concat();
    rewritten(&of("linuxcnc"))
        .exits(2)
        .says("--allow-call P9100");
    let call = ["--allow-call", "P9100"];
    let all = [&of("linuxcnc")[..], &call].concat();
    let said = rewritten(&all).exits(0).out;
    assert!(said.contains("begins in G90 G21 G17 G94 G98"), "{said}");
    assert!(
        said.contains("as LinuxCNC means it, may call O9100"),
        "{said}"
    );
    let list = umi(&["program", "list", "--json", "--port", port]);
    let kept = list.exits(0).json()["programs"][0].clone();
    let begins_in = serde_json::json!(["G90", "G21", "G17", "G94", "G98"]);
    assert_eq!(kept["begins_in"], begins_in);
    let expected = serde_json::json!({
        "start_packed": 26_705,
        "dialect": "linux_cnc",
        "allow_call": 9100,
    });
    assert_eq!(kept["stated"], expected);
    // The same once more is there already; said otherwise it is put anew.
    let again = rewritten(&[&all[..], &["--json"]].concat());
    assert_eq!(again.exits(0).json()["was_there"], true);
    let other = [&of("fanuc")[..], &call, &["--json"]].concat();
    assert_eq!(rewritten(&other).exits(0).json()["was_there"], false);
    for (option, value, named) in [
        ("--start", "G59.1", "G54 to G59"),
        ("--allow-call", "<finish>", "no name"),
        ("--allow-call", "P70000", "P1 to P65535"),
    ] {
        rewritten(&[option, value]).exits(1).says(named);
    }
    let two = ["--allow-call", "P1", "--allow-call", "P2"];
    rewritten(&two).exits(1).says("one number");
    put(&start).exits(1).says("needs --release rewritten");
}
