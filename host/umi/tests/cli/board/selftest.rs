//! `umi selftest`, against a port that answers as the self-test's image does, or otherwise.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::thread;

use crate::rig::run::{Folder, umi};

const PASSES: &str =
    "selftest\t1\tpico\t0.1.0\nrow\tposition of axis 1\t4000\t4000\tcounts\tpass\n";

/// The address of a port that gives this answer to one request, which it returns.
fn port(answer: String) -> (String, thread::JoinHandle<String>) {
    let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let address = format!("tcp://{}", listener.local_addr().unwrap());
    let answers = thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut request = String::new();
        BufReader::new(stream.try_clone().unwrap())
            .read_line(&mut request)
            .unwrap();
        stream.write_all(answer.as_bytes()).unwrap();
        request
    });
    (address, answers)
}

/// A table is shown, kept and told as JSON; a row that fails is the exit status.
#[test]
fn a_table_is_shown_and_kept() {
    let folder = Folder::new();
    let file = &folder.path("board.json");

    let (address, asked) = port(format!("{PASSES}end\t1\t0\n"));
    let arguments = [
        "selftest",
        "--port",
        &address,
        "--restarts",
        "7",
        "-o",
        file,
    ];
    let shown = umi(&arguments).exits(0).out;
    assert!(shown.contains("all 1 rows pass"), "{shown}");
    assert_eq!(asked.join().unwrap(), "run 7 40\n");
    let kept: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    assert_eq!(kept["passed"], true);
    assert_eq!(kept["rows"][0]["measured"], 4000);
    assert_eq!(kept["restarts"], 7);

    let row = "row\ttheir instants\t<= 3000\t3001\tns off\tfail\n";
    let (address, _) = port(format!("{PASSES}{row}end\t2\t1\n"));
    let told = umi(&["selftest", "--port", &address, "--json"])
        .exits(2)
        .json();
    assert_eq!(told["passed"], false);
    assert_eq!(told["rows"][1]["promised"]["at_most"], 3000);
}

/// A file that is there is not replaced, another image is named, and a table that is cut off or
/// contradicts itself is no table.
#[test]
fn what_is_wrong_is_said() {
    let folder = Folder::new();
    let file = &folder.file("there.json", "mine");
    umi(&["selftest", "--port", "tcp://127.0.0.1:9", "-o", file])
        .exits(1)
        .says("is there already");

    let answers = [
        (String::new(), "the board's port"),
        ("hello\n".into(), "no line of a self-test"),
        (PASSES.replace("pass", "fail"), "verdict"),
    ];
    for (answer, says) in answers {
        let (address, _) = port(answer);
        umi(&["selftest", "--port", &address, "--seconds", "1"])
            .exits(1)
            .says(says);
    }
}

/// A board that hangs, resets or is unplugged has shown what it is by then: that is kept, and is no pass.
#[test]
fn what_has_come_of_a_table_is_kept() {
    let folder = Folder::new();
    let row = "row\ttheir instants\t<= 3000\t3001\tns off\tfail\n";
    for (k, (answer, rows, says)) in [
        (PASSES.to_owned(), 1, "the board's port"),
        (format!("{PASSES}{row}"), 2, "the board's port"),
        (format!("{PASSES}end\t2\t0\n"), 1, "rows are missing"),
    ]
    .into_iter()
    .enumerate()
    {
        let file = folder.path(&format!("{k}.json"));
        let (address, _) = port(answer);
        let ran = umi(&[
            "selftest",
            "--port",
            &address,
            "--seconds",
            "1",
            "-o",
            &file,
        ])
        .exits(2);
        assert!(ran.out.contains("not to its end"), "{}", ran.out);
        assert!(ran.out.contains(says), "{}", ran.out);
        let text = std::fs::read_to_string(&file).unwrap();
        let kept: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(kept["rows"].as_array().unwrap().len(), rows);
        assert_eq!(
            (&kept["complete"], &kept["passed"]),
            (&false.into(), &false.into())
        );
        assert!(kept["error"]["message"].as_str().unwrap().contains(says));
    }
}
