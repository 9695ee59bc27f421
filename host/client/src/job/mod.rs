//! What a job sees, and what becomes of its verdict.
//!
//! | room | idea |
//! | --- | --- |
//! | [`guards`] | what a job sees of what can go wrong, and from how many micrometres on |
//! | [`probing`] | what a hit scatters, from repeated ones |
//! | [`correction`] | the rigid motion of a verdict, and its program |

pub mod correction;
pub mod guards;
pub mod probing;
