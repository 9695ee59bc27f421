//! The probing macros of `hw/control`, each run by the interpreter on the virtual machine
//! from a grid of starts and poses. Inside the grid the fits of what they print are the
//! scene's truth; outside they end with their own alarm, never with a collision and never
//! with a wrong answer.

mod anywhere;
mod bench;
mod calls;
mod faces;
mod grbl;
mod lines;
mod plate;
mod rounds;
mod shifts;
mod sphere;
