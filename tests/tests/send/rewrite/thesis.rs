//! Appendix E of the thesis under each transform of its table 4.2.

use umi_core::rewrite::RewriteRefusal;

use crate::rewrite::{rewritten, settings, table_4_2};

fn read(name: &str) -> String {
    let path = format!("{}/reference/toolpath/{name}", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(path).unwrap()
}

/// Every block is within half of the printed increment of what an independent script says,
/// on all three axes; the words that the thesis' program lost are there.
#[test]
fn appendix_e_is_where_the_script_says() {
    let program = read("appendix_e.nc");
    for case in 1..=4 {
        let (made, summary) = rewritten(&settings(table_4_2(case), 1.0), &program).unwrap();
        let mut at = [f64::NAN; 3];
        let mut places = std::collections::HashMap::new();
        for line in made
            .lines()
            .filter(|line| !line.contains("G10") && !line.contains("G28"))
        {
            let mut number = 0;
            for word in line
                .split_whitespace()
                .take_while(|word| !word.starts_with('('))
            {
                let value = word[1..].parse::<f64>();
                match (word.as_bytes()[0], value) {
                    (b'N', Ok(n)) => number = n as u32,
                    (letter @ b'X'..=b'Z', Ok(value)) => at[usize::from(letter - b'X')] = value,
                    _ => {}
                }
            }
            places.insert(number, at);
        }
        let script = read(&format!("appendix_e_case{case}.csv"));
        let mut compared = 0;
        for row in script.lines().skip(1) {
            let values: Vec<f64> = row.split(',').map(|value| value.parse().unwrap()).collect();
            let place = places[&(values[0] as u32)];
            for (axis, (written, image)) in place.iter().zip(&values[4..]).enumerate() {
                // At home the height is the machine's: the axis stands still until N150.
                if values[0] == 140.0 && axis == 2 {
                    continue;
                }
                assert!(
                    (written - image).abs() <= 0.0005 + 1e-9,
                    "case {case}, {row}: {written}"
                );
                compared += 1;
            }
        }
        assert_eq!(compared, 3 * 35 - 1);
        assert_eq!((summary.feeds, summary.rapids), (12, 23));
        // What appendix F dropped and a control needs.
        for kept in [
            "N20 G10 P1 Z85.0 R4.0 T00\n",
            "N30 G10 L2 P1 X0.0 Y0.0 Z0.0 (Top)\n",
            "N70 G28 G91 Z0 H0\nN80 G28 X0 Y0\n",
            "N100 T00 M06 (8.0 MM DIA BALL NOSE MILL)\nN110 G54\n",
            "N130 S5000 M3 M42\n",
            " H00 M7\n",
            " F1000.0\n",
        ] {
            assert!(made.contains(kept), "{kept}: {made}");
        }
    }
}

/// What appendix F filled in from modal state is filled in: a pure Z motion moves all three
/// axes where the transform leans, in three decimals.
#[test]
fn axes_are_filled_in_as_in_appendix_f() {
    let (made, _) = rewritten(
        &settings(table_4_2(1), 1.0),
        "G21 G90 G0 X0. Y0. Z100.\nZ0.\n",
    )
    .unwrap();
    let last = made.lines().last().unwrap();
    assert!(
        ["X", "Y", "Z"].iter().all(|axis| last.contains(axis)),
        "{last}"
    );
}

/// `G54P1` as printed is not the offset that the program set.
#[test]
fn as_printed_it_changes_its_work_offset() {
    let printed = read("appendix_e.nc").replace("N110 G54\n", "N110 G54P1\n");
    let refusal = rewritten(&settings(table_4_2(1), 1.0), &printed).unwrap_err();
    assert_eq!(
        (refusal.line, refusal.reason),
        (17, RewriteRefusal::WorkOffset)
    );
}
