//! The table of the images as a page.

use crate::tasks::firmware::toolchain::Compiler;

/// What stands around the table: what the columns are.
const ABOUT: &str = "
Bytes, and calls of panics. Each figure stands before its budget, which `cargo xtask size` holds, also against the room for the stack.

- **flash**: code, constants and the initial values of variables.
- **static**: variables.
- **stack**: the worst that the code can need, worked out from the calls in it and the compiler's stack sizes: all levels of interrupts at their worst at once, then a panic, then a fault. `cargo xtask size BOARD --stack` lists the calls.
- **room**: what the variables leave for the stack.
- **panics**: calls of the core library's panics; **ours**: of them, in functions of this project.
- **in interrupts**: of them, those that a handler of the vector table can reach, counted for each handler, without the tasks that it runs. `cargo xtask size BOARD --panics` lists them.

On the emulated Pico the golden session is held to 41000 bytes of stack that it really needs (`tests/tests/boards/conformance.rs`). What the same work costs in instructions is in [RESULTS.md](RESULTS.md).
";

/// The page: its rows are the heads of the columns, then the images.
pub fn markdown<const N: usize, const M: usize>(
    rows: &[[String; N]],
    reachable: &[[String; M]],
    compiler: &Compiler,
) -> String {
    let mut page = format!(
        "# What the firmware images take\n\nWritten by `cargo xtask size --write`, with {}.\n\n",
        compiler.version
    );
    table(&mut page, rows, 1);
    page.push_str(ABOUT);
    page.push_str(REACHABLE);
    // Interrupts without any are left out.
    let all = reachable.iter().filter(|row| row[M - 1] != "0");
    table(&mut page, &all.cloned().collect::<Vec<_>>(), 3);
    page
}

/// What stands above the second table.
const REACHABLE: &str = "
What each interrupt and each task can reach, those without any left out; one call of a panic may count for several.

";

/// A table whose first columns are text.
fn table<const N: usize>(page: &mut String, rows: &[[String; N]], text: usize) {
    for (index, row) in rows.iter().enumerate() {
        page.push_str(&format!("| {} |\n", row.join(" | ")));
        if index == 0 {
            let (left, right) = ("---|".repeat(text), "---:|".repeat(N - text));
            page.push_str(&format!("|{left}{right}\n"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The heads, a rule, and each image's row: a table as Markdown has it.
    #[test]
    fn table() {
        let rows = [["image", "flash"], ["pico", "330212"]].map(|row| row.map(String::from));
        let compiler = Compiler {
            version: "rustc 1.95.0".into(),
            origin: "a test's",
            is_pinned: true,
            pinned: "1.95.0".into(),
        };
        let reachable = [
            ["image", "what", "name", "panics"],
            ["pico", "interrupt", "UART0_IRQ", "0"],
            ["pico", "task", "serve", "41"],
        ]
        .map(|row| row.map(String::from));
        let page = markdown(&rows, &reachable, &compiler);
        assert!(page.contains("with rustc 1.95.0."), "{page}");
        assert!(
            page.contains("| image | flash |\n|---|---:|\n| pico | 330212 |\n"),
            "{page}"
        );
        let second = "|---|---|---|---:|\n| pico | task | serve | 41 |\n";
        assert!(page.ends_with(second), "{page}");
    }
}
