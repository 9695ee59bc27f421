//! The table of requests that stands before the messages, held against the requests themselves.

use std::collections::BTreeSet;

const PAGE: &str = include_str!("../../src/message/mod.rs");
const REQUESTS: &str = include_str!("../../src/message/request.rs");

/// A request: its name, its answers, whose key it needs.
type Row = (String, BTreeSet<String>, String);

fn quoted(text: &str) -> impl Iterator<Item = String> {
    text.split('`').skip(1).step_by(2).map(str::to_owned)
}

/// `//! | `Name` | `Answer` or `Answer` | role | what it does |`
fn page() -> Vec<Row> {
    let rows = PAGE.lines().filter_map(|line| line.strip_prefix("//! | `"));
    rows.map(|row| {
        let row = format!("`{row}");
        let cells: Vec<&str> = row.split('|').collect();
        let name = quoted(cells[0]).next().unwrap();
        (name, quoted(cells[1]).collect(), cells[2].trim().to_owned())
    })
    .collect()
}

/// `Name… => Class, Role, Answer | Answer;`
fn requests() -> Vec<Row> {
    let declared = REQUESTS.split_once("\nrequests! {").unwrap().1;
    let code: String = declared
        .lines()
        .filter(|line| !line.trim_start().starts_with("///"))
        .collect::<Vec<_>>()
        .join("\n");
    let rows = code.split(";\n").filter(|row| row.contains("=>"));
    rows.map(|row| {
        let (request, row) = row.split_once("=>").unwrap();
        let request = request
            .rsplit_once("pub enum Request {")
            .map_or(request, |r| r.1);
        let name = request.trim().split(['(', ' ', '{']).next().unwrap();
        let cells: Vec<&str> = row.split(',').map(str::trim).collect();
        let answers = cells[2].split('|').map(|answer| answer.trim().to_owned());
        (name.to_owned(), answers.collect(), cells[1].to_owned())
    })
    .collect()
}

/// Each request has its row, in the same order, with its role and answers that it can get.
#[test]
fn the_table_of_requests_is_true() {
    let (page, requests) = (page(), requests());
    assert!(page.len() > 40, "read {} rows only", page.len());
    let names = |rows: &[Row]| {
        rows.iter()
            .map(|row| row.0.clone())
            .collect::<BTreeSet<_>>()
    };
    assert_eq!(names(&page), names(&requests));
    for (name, answers, needs) in &page {
        let (_, can_be, role) = requests.iter().find(|row| row.0 == *name).unwrap();
        let role = role.to_lowercase();
        let role = if role == "nobody" || role == "none" {
            "nobody"
        } else {
            &role
        };
        assert!(
            needs.starts_with(role),
            "{name} needs {role}, the table says {needs}"
        );
        assert!(
            answers.is_subset(can_be),
            "{name}: {answers:?} of {can_be:?}"
        );
    }
}
