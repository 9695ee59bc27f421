//! `umi watch`: what is known of a board at one moment, and how it looks.
//!
//! ```text
//! board ◄─► Session ─► View ─► screen (ratatui) ─► terminal, or plain text
//!                        └───► JSON
//! ```

pub mod digits;
pub mod screen;
mod session;
mod terminal;
mod view;

pub use session::Session;
pub use terminal::{TURN, run};
pub use view::{Link, View};
