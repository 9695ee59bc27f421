//! `umi program`, against a virtual board.

use std::sync::Arc;

use umi_virtual::serve::{Place, Port};
use umi_virtual::{Config, VirtualBoard};

use crate::run::{Folder, umi};

/// A virtual board on a port of this machine: its address.
fn board() -> String {
    let board = Arc::new(VirtualBoard::start(Config::default()).unwrap());
    let port = Port::open(&Place::Tcp(0)).unwrap();
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

/// A number may be given; without one and without an O line there is none, and a program
/// that finds no room is refused with figures.
#[test]
fn what_cannot_be_put_is_named() {
    let (folder, port) = (Folder::new(), board());
    let port = port.as_str();
    let file = folder.file("nameless.nc", "G21\nM30\n");
    umi(&["program", "put", &file, "--port", port])
        .exits(1)
        .says("--number");
    umi(&["program", "put", &file, "--number", "O7", "--port", port]).exits(0);
    let long = folder.file("long.nc", "G1 X1.\n".repeat(700_000));
    let refused = umi(&[
        "program", "put", &long, "--number", "8", "--json", "--port", port,
    ]);
    let error = refused.exits(2).json()["error"].clone();
    assert_eq!(error["code"], "program_store_full");
    assert_eq!(error["needed_bytes"], 4_900_000);
    assert!(error["longest_bytes"].as_u64().unwrap() < 4 << 20);
}
