//! What the board's owner and an outsider rely on: limits, kept evidence, signatures.
//!
//! | file | idea |
//! | --- | --- |
//! | `custody` | what is kept for the owner: configuration, acknowledged entries, the last run |
//! | [`heads`] | when the board signs for its journal |
//! | `signer` | who signs for it, and what is known of what was signed |
//! | `refusals` | what somebody was refused: one record a minute |
//! | `bucket` | how often somebody may do what costs room for evidence |

pub(crate) mod bucket;
pub(crate) mod custody;
pub mod heads;
pub(crate) mod refusals;
pub(crate) mod signer;
