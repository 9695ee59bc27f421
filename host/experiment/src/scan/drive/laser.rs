//! In which blocks of a program the laser is on.
//!
//! The programs of `umi scan plan` say so in comments: `LASER ON` before the block that goes to a
//! pass's first pose, `LASER OFF` before a link. A program without such comments scans from its
//! first block to its last.

/// For each line of a text, from its first: whether the laser is on while it runs.
#[must_use]
pub fn lit(program: &str) -> Vec<bool> {
    if !program.contains("LASER ON") {
        return program.lines().map(|_| true).collect();
    }
    let (mut on, mut begins) = (false, false);
    program
        .lines()
        .map(|line| {
            let line = line.trim();
            if line.starts_with('(') || line.starts_with(';') {
                begins = line.contains("LASER ON");
                on = on && !begins && !line.contains("LASER OFF");
                return false;
            }
            if begins && !line.is_empty() {
                // This block goes to the first pose.
                (on, begins) = (true, false);
                return false;
            }
            on
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::lit;

    #[test]
    fn the_block_to_a_passes_first_pose_is_dark() {
        let program = "%\nG0 X1\n(PASS 0: LASER ON)\nG1 X2\nG1 X3\nG1 X4\n(LINK: LASER OFF)\nG1 X5\n\
                       (PASS 1: LASER ON)\nG1 X6\nG1 X7\nG94\n";
        let lines: Vec<usize> = lit(program)
            .into_iter()
            .zip(1..)
            .filter_map(|(on, line)| on.then_some(line))
            .collect();
        assert_eq!(lines, [5, 6, 11, 12]);
    }

    #[test]
    fn a_program_that_says_nothing_scans_always() {
        assert_eq!(lit("G0 X1\nG1 X2"), [true, true]);
    }
}
