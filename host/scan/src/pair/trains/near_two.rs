//! What is within the jitter of two of the other stream. The shift of the clocks is settled all the same, by all the
//! others; which of the two it is nothing tells.

use super::Trains;

/// Two ways to pair that both keep to the jitter, as the caller counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::pair) enum NearTwo {
    /// A profile near two latches.
    Latches {
        /// The profile.
        profile: usize,
        /// The latches.
        latches: [usize; 2],
    },
    /// Two profiles near one latch.
    Profiles {
        /// The profiles.
        profiles: [usize; 2],
        /// The latch.
        latch: usize,
    },
}

impl NearTwo {
    /// Whose latch is not told.
    pub(in crate::pair) fn profiles(&self) -> Vec<usize> {
        match self {
            Self::Latches { profile, .. } => vec![*profile],
            Self::Profiles { profiles, .. } => profiles.to_vec(),
        }
    }

    /// By the numbers of profiles and latches.
    pub(in crate::pair) fn in_words(
        &self,
        profile_number: impl Fn(usize) -> u64,
        latch_number: impl Fn(usize) -> u64,
        jitter_us: f64,
    ) -> String {
        match self {
            Self::Latches { profile, latches } => {
                let [one, other] = latches.map(latch_number);
                let profile = profile_number(*profile);
                format!(
                    "profile {profile} is within {jitter_us} µs of latch {one} and of latch {other}"
                )
            }
            Self::Profiles { profiles, latch } => {
                let [one, other] = profiles.map(profile_number);
                let latch = latch_number(*latch);
                format!("profiles {one} and {other} are within {jitter_us} µs of latch {latch}")
            }
        }
    }
}

/// Where the clocks' line alone does not tell what belongs together, by profile.
pub(in crate::pair) fn all(
    trains: &Trains,
    found: &[Option<usize>],
    (offset, drift): (f64, f64),
) -> Vec<NearTwo> {
    let origin = trains.origin(found);
    let mut owners = vec![None; trains.board.len()];
    for (profile, latch) in found.iter().enumerate() {
        if let Some(latch) = *latch {
            owners[latch] = Some(profile);
        }
    }
    let mut doubts = Vec::new();
    for (profile, latch) in found.iter().enumerate() {
        let place = trains.place(profile);
        let at = offset + (1.0 + drift) * trains.sensor[place];
        let begin = trains.board.partition_point(|&t| t < at - trains.jitter_us);
        let near = trains.board[begin..]
            .iter()
            .take_while(|&&t| t <= at + trains.jitter_us)
            .enumerate()
            .map(|(i, _)| begin + i)
            .filter(|&candidate| trains.agrees(place, candidate, origin));
        for candidate in near.filter(|&candidate| *latch != Some(candidate)) {
            if let Some(own) = *latch {
                doubts.push(NearTwo::Latches {
                    profile,
                    latches: [own.min(candidate), own.max(candidate)],
                });
            }
            // A latch near two profiles is as bad as a profile near two latches.
            if let Some(owner) = owners[candidate] {
                doubts.push(NearTwo::Profiles {
                    profiles: [owner.min(profile), owner.max(profile)],
                    latch: candidate,
                });
            }
        }
    }
    doubts
}
