//! In which blocks of a program the laser is on.
//!
//! The programs of `umi scan plan` say so in comments: `LASER ON` behind the block that goes to a
//! pass's first pose, `LASER OFF` behind the one that goes to its last. A program without such
//! comments scans from its first block to its last.

/// For each line of a text, from its first: whether the laser is on while it runs.
#[must_use]
pub fn lit(program: &str) -> Vec<bool> {
    let mut on = !program.contains("LASER ON");
    program
        .lines()
        .map(|line| {
            let line = line.trim();
            if !line.starts_with('(') && !line.starts_with(';') {
                return on;
            }
            if line.contains("LASER O") {
                on = line.contains("LASER ON");
            }
            false
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::lit;

    #[test]
    fn the_ways_to_a_pass_and_between_passes_are_dark() {
        let program = "%\nG0 X1\nG1 X2\n(PASS 0: LASER ON)\nG1 X3\nG1 X4\n(LINK: LASER OFF)\nG1 X5\n\
                       G1 X6\n(PASS 1: LASER ON)\nG1 X7\n(LINK: LASER OFF)\nG1 X8\n(PASS 2: LASER ON)\n\
                       G1 X9\n(END: LASER OFF)\nG94\n";
        let lines: Vec<usize> = lit(program)
            .into_iter()
            .zip(1..)
            .filter_map(|(on, line)| on.then_some(line))
            .collect();
        assert_eq!(lines, [5, 6, 11, 15]);
    }

    #[test]
    fn a_program_that_says_nothing_scans_always() {
        assert_eq!(lit("G0 X1\nG1 X2"), [true, true]);
    }
}
