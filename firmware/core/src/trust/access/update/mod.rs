//! Signed updates, without I/O of their own: what an image is, and two slots of which one runs.
//!
//! | file | idea |
//! | --- | --- |
//! | [`image`] | the header of a `.umif` file, its signature, its bytes |
//! | [`slots`] | receiving, trial, confirmation, going back; through power cuts |
//! | `state` | which image counts, as it is kept |

pub mod image;
pub mod slots;
mod state;
