//! The host's port.
//!
//! | file | idea |
//! | --- | --- |
//! | [`link`] | frames; requests are answered, events told |
//! | [`answer`] | an answer to each request |
//! | [`programs`] | part programs: uploaded, listed, deleted, offered |

mod answer;
pub(crate) mod link;
mod programs;
