//! The table of the figures, in Markdown.

use std::fmt::Write as _;

use super::Machine;
use super::figures::Figures;

/// What must be known to read the table rightly.
const NOTES: &str = "\
Times are medians of 21 rounds of at least 20 ms, with the fastest and the slowest round; \
contenders in Rust take turns. \
Reading and rewriting are given in bytes: those of the session's or the program's text. \
Instructions are those of one call, counted by valgrind: the same binary gives the same count, which seconds never do. \
A ratio is that of the contender to umi-core: above 1 umi-core needs less. All contenders of a \
task came to the same answer, or there would be no table.

- **umi-core** reads byte by byte, detects code and parity, tells programs from points, and counts \
what it cannot use. It fits with the full Hessian, proves the minimum, and checks spread, condition and \
uncertainty; it uses no heap, `libm` for every root, and stops at an integer overflow. A \
registration carries the covariance of its six parameters.
- **regex**, in Rust and in Python (`re`), are our own short scripts on those libraries: lines of \
three numbers, and nothing else. They know no parity, blocks, programs or doubts, and drop without \
a word what does not match.
- **gcode** is our own short script on the parser crate of that name: it carries G0 and G1 with X, Y, \
Z and knows no modes, arcs, offsets or refusals.
- **levenberg-marquardt** is the Rust crate of that name, a translation of MINPACK, from the same \
linear start; the covariance is `sigma² inv(JᵀJ)`.
- **nalgebra SVD** is the textbook's closed form on nalgebra's decomposition, and nothing else. The \
rows below it add one guarantee of umi-core each, in our own short scripts on nalgebra: points \
that cannot be registered are refused; the residuals are known; the six parameters have a \
covariance, here by normal equations. What is left to umi-core is a rotation polished to the last \
digit, and a covariance without the square of the condition.
- **`umi nc rewrite`** is the command as typed, with the start of the program, two readings and \
the writing of the file.
- **SciPy** is called from Python, as a process engineer's script would: `least_squares` \
(MINPACK) with the analytic Jacobian, and `Rotation.align_vectors`. With few points it \
measures Python.
";

/// The whole page.
pub fn markdown(machine: &Machine, all: &[Figures]) -> String {
    let mut page = String::from("# Benchmarks\n\nWritten by `cargo xtask bench`.\n\n");
    let _ = writeln!(
        page,
        "Machine: {}, {} cores; {}.\n",
        machine.processor, machine.cores, machine.rustc
    );
    page.push_str(
        "| task | by | median | fastest to slowest | ratio | instructions | ratio |\n\
         |---|---|---:|---:|---:|---:|---:|\n",
    );
    for figures in all_by_task(all) {
        page.push_str(&row(figures, all));
    }
    page.push('\n');
    page.push_str(NOTES);
    page
}

/// Contenders of one task side by side, tasks in the order in which they first occur.
fn all_by_task(all: &[Figures]) -> impl Iterator<Item = &Figures> {
    let mut tasks: Vec<&str> = Vec::new();
    for figures in all {
        if !tasks.contains(&figures.task.as_str()) {
            tasks.push(&figures.task);
        }
    }
    tasks
        .into_iter()
        .flat_map(|task| all.iter().filter(move |figures| figures.task == task))
}

fn row(figures: &Figures, all: &[Figures]) -> String {
    let first = all.iter().find(|first| first.task == figures.task);
    let ratio = |of: &dyn Fn(&Figures) -> Option<f64>| match (of(figures), first.and_then(of)) {
        (Some(this), Some(first)) if first > 0.0 => format!("{:.2}", this / first),
        _ => "–".to_owned(),
    };
    let instructions = match (figures.instructions, figures.bytes) {
        (Some(count), Some(bytes)) => format!("{:.1} a byte", count as f64 / bytes),
        (Some(count), None) => count.to_string(),
        (None, _) => "–".to_owned(),
    };
    format!(
        "| {} | {} | {} | {} to {} | {} | {} | {} |\n",
        figures.task,
        figures.by,
        pace(figures.median_ns, figures.bytes),
        pace(figures.min_ns, figures.bytes),
        pace(figures.max_ns, figures.bytes),
        ratio(&|figures| Some(figures.median_ns)),
        instructions,
        ratio(&|figures| figures.instructions.map(|count| count as f64)),
    )
}

/// A time of a call, or bytes a second where the task is reading.
fn pace(ns: f64, bytes: Option<f64>) -> String {
    match bytes {
        Some(bytes) => format!("{:.1} MB/s", bytes * 1e3 / ns),
        None => format!("{:.2} µs", ns / 1e3),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows stand by task, with ratios to the first contender; what was not counted is
    /// not made up.
    #[test]
    fn rows() {
        let figures = |task: &str, by: &str, ns: f64, instructions| Figures {
            task: task.into(),
            by: by.into(),
            median_ns: ns,
            min_ns: ns / 2.0,
            max_ns: ns * 2.0,
            instructions,
            ..Figures::default()
        };
        let mut text = figures("text", "us", 1000.0, Some(40_000));
        text.bytes = Some(4000.0);
        let all = [
            figures("sphere", "us", 2000.0, Some(100)),
            text,
            figures("sphere", "they", 5000.0, None),
        ];
        let rows: String = all_by_task(&all).map(|one| row(one, &all)).collect();
        assert_eq!(
            rows,
            "| sphere | us | 2.00 µs | 1.00 µs to 4.00 µs | 1.00 | 100 | 1.00 |\n\
             | sphere | they | 5.00 µs | 2.50 µs to 10.00 µs | 2.50 | – | – |\n\
             | text | us | 4000.0 MB/s | 8000.0 MB/s to 2000.0 MB/s | 1.00 | 10.0 a byte | 1.00 |\n"
        );
    }
}
