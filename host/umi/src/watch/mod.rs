//! `umi watch`: a board's state at one moment, and its read-out.
//!
//! ```text
//! board ◄─► Session ─► View ─► screen (ratatui) ─► terminal, or plain text
//!                        └───► JSON
//! ```

pub mod digits;
pub mod screen;
mod session;
mod skip_line;
mod terminal;
mod view;

pub(crate) use session::Session;
pub use terminal::{TURN, run};
pub(crate) use view::View;
