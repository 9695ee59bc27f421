//! What can go wrong: the kinds of damage.

/// One way in which a session is spoilt, or not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DamageKind {
    /// Nothing is wrong.
    Clean,
    /// The plate is up to 5 K warmer or colder than taught.
    Warm,
    /// A line comes twice.
    LineTwice,
    /// A digit of a line is another one.
    DigitChanged,
    /// A character is lost.
    CharacterLost,
    /// A line is lost.
    LineLost,
    /// Two lines change places.
    LinesSwapped,
    /// A sign is lost.
    SignLost,
    /// All lines of a ball are lost.
    BallLost,
    /// The control is a clamping ahead of what the board reads.
    Late,
    /// Probed in another work offset than was taught in.
    OffsetMoved,
    /// An older clamping stood in a buffer when the part was taught.
    OldBeforeTeaching,
    /// The clamping that was to be taught is refused.
    TeachingRefused,
    /// Nothing of a clamping comes; the control reads all the same.
    NothingCame,
    /// The balls come in another order than the job's; where one closes, between it and the one
    /// that it repeats.
    OtherOrder,
    /// One or two balls are those of the clamping before, which stood elsewhere by 10 to 100 µm.
    BallsOfTwo,
    /// The top is touched 10 to 50 µm early at first, and the sides follow.
    EarlyTop,
    /// A longer probe or a bent stylus: all hits off by 10 to 60 µm.
    BentStylus,
    /// A worn stylus scatters by 5 to 20 µm.
    WornStylus,
    /// The part drifts by 5 to 50 µm while it is probed.
    Drift,
    /// The part slips by 5 to 50 µm between two balls.
    Slip,
    /// Z is read too long or too short by 10 to 100 ppm.
    ZScale,
    /// The same digit is wrong in all hits of a ball.
    SameDigit,
    /// A chip of 10 to 50 µm lies on a ball: each touch of its top is early.
    ChipOnTop,
    /// A `G52` or `G92` of 0.05 to 50 mm is active that was not when the part was taught.
    ShiftActive,
    /// The coordinates are shifted by as much while it is probed, before one of the balls: by
    /// `G52`, `G92`, `G10`, another work offset.
    ShiftWhileProbed,
    /// The part slips by 5 to 50 µm between two balls, probed in an order in which the closing one
    /// does not enclose all: one lies before the ball that it repeats, or behind it.
    SlipOutside,
    /// Probed with a tool length in force that is another one than when it was taught, by 0.005
    /// to 50 mm.
    OtherLength,
    /// The part slips by 5 to 50 µm between two hits of a ball.
    SlipInBall,
    /// The part turns about the first ball, upright or tilted, between two balls: of those that
    /// were probed before, the one that moves most does so by 5 µm to 5 mm.
    TurnedAboutFirst,
    /// The part turns on the table about any place, by as much.
    TurnedAnywhere,
    /// The part rocks over two of its balls, or over a level line through one, by as much.
    Rocked,
    /// The part slips or turns by 5 to 50 µm when the first closing ball has been probed, or behind
    /// the last hit.
    MovedBehind,
    /// A chip of 10 to 50 µm on each of two balls.
    TwoChips,
    /// Probed at a feed 1.5 to 6 times that of the taught clamping: each touch is 1 to 20 µm later.
    OtherFeed,
    /// A chip of 10 to 50 µm on each datum ball but one, all alike.
    EqualChips,
    /// The control rounds to 20 to 100 µm.
    CoarseStep,
    /// Dust of 10 to 50 µm on the top of each ball of the part, all alike; not on the one on the
    /// table.
    DustOnAll,
    /// The stylus is bent by 10 to 60 µm between two balls of the part.
    BentInRun,
    /// The ball on the table is probed before the last of the part's, and the stylus is bent by as
    /// much behind it. Where there is none, the stylus is bent there.
    BentBehindTable,
    /// The part moves by 5 to 50 µm before a ball, and is back before another one, the first
    /// closing ball at the latest.
    CameBack,
    /// A ball has moved on its plate by 10 to 50 µm since it was taught.
    BallMoved,
    /// Another plate of the same drawing: each ball elsewhere by 5 to 60 µm.
    OtherPlate,
    /// The clamps bow the plate: its outermost ball is higher or lower by 10 to 50 µm against the
    /// part in its middle, the others as the square of their distance.
    Bowed,
    /// The fast touches, by which a ball is found, scatter by 6 µm: what a control with a delay of
    /// up to 4 ms makes of 300 mm/min.
    FastScatter,
}

impl DamageKind {
    /// All of them.
    pub const ALL: [Self; 45] = [
        Self::Clean,
        Self::Warm,
        Self::LineTwice,
        Self::DigitChanged,
        Self::CharacterLost,
        Self::LineLost,
        Self::LinesSwapped,
        Self::SignLost,
        Self::BallLost,
        Self::Late,
        Self::OffsetMoved,
        Self::OldBeforeTeaching,
        Self::TeachingRefused,
        Self::NothingCame,
        Self::OtherOrder,
        Self::BallsOfTwo,
        Self::EarlyTop,
        Self::BentStylus,
        Self::WornStylus,
        Self::Drift,
        Self::Slip,
        Self::ZScale,
        Self::SameDigit,
        Self::ChipOnTop,
        Self::ShiftActive,
        Self::ShiftWhileProbed,
        Self::SlipOutside,
        Self::OtherLength,
        Self::SlipInBall,
        Self::TurnedAboutFirst,
        Self::TurnedAnywhere,
        Self::Rocked,
        Self::MovedBehind,
        Self::TwoChips,
        Self::OtherFeed,
        Self::EqualChips,
        Self::CoarseStep,
        Self::DustOnAll,
        Self::BentInRun,
        Self::BentBehindTable,
        Self::CameBack,
        Self::BallMoved,
        Self::OtherPlate,
        Self::Bowed,
        Self::FastScatter,
    ];

    /// For the table.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Clean => "clean",
            Self::Warm => "up to 5 K warmer or colder than taught",
            Self::LineTwice => "a line comes twice",
            Self::DigitChanged => "a digit changed",
            Self::CharacterLost => "a character lost",
            Self::LineLost => "a line lost",
            Self::LinesSwapped => "two lines exchanged",
            Self::SignLost => "a sign lost",
            Self::BallLost => "all lines of a ball lost",
            Self::Late => "text late by one clamping",
            Self::OffsetMoved => "work offset moved after teaching",
            Self::OldBeforeTeaching => "an old clamping before teaching",
            Self::TeachingRefused => "the taught clamping refused",
            Self::NothingCame => "nothing came, READ all the same",
            Self::OtherOrder => "balls in another order",
            Self::BallsOfTwo => "balls of two clampings",
            Self::EarlyTop => "top touched early once, sides follow, 10-50 µm",
            Self::BentStylus => "longer probe, bent stylus, 10-60 µm",
            Self::WornStylus => "worn stylus, 5-20 µm",
            Self::Drift => "drift while probing, 5-50 µm",
            Self::Slip => "slip while probing, 5-50 µm",
            Self::ZScale => "Z scale, 10-100 ppm",
            Self::SameDigit => "same digit wrong in a block",
            Self::ChipOnTop => "chip on a top, every touch early, 10-50 µm",
            Self::ShiftActive => "G52 or G92 active since teaching",
            Self::ShiftWhileProbed => "G52, G92, G10 or another offset while probing",
            Self::SlipOutside => "slip while probing, in any order",
            Self::OtherLength => "another tool length in force than when taught",
            Self::SlipInBall => "slip between two hits of a ball, 5-50 µm",
            Self::TurnedAboutFirst => "turned about the first ball while probing, 5 µm to 5 mm",
            Self::TurnedAnywhere => "turned about any place while probing, 5 µm to 5 mm",
            Self::Rocked => "rocked over two balls while probing, 5 µm to 5 mm",
            Self::MovedBehind => "slipped or turned behind the first closing ball, 5-50 µm",
            Self::TwoChips => "chips on two tops, 10-50 µm",
            Self::OtherFeed => "probed at another feed, each touch 1-20 µm later",
            Self::EqualChips => "equal chips on all tops but one, 10-50 µm",
            Self::CoarseStep => "a control's step of 20-100 µm",
            Self::DustOnAll => "dust alike on all tops of the part, 10-50 µm",
            Self::BentInRun => "stylus bent between two balls, 10-60 µm",
            Self::BentBehindTable => {
                "bent behind a ball on the table that came too early, 10-60 µm"
            }
            Self::CameBack => "moved and came back while probing, 5-50 µm",
            Self::BallMoved => "a ball moved on its plate since teaching, 10-50 µm",
            Self::OtherPlate => "another plate of the same drawing, balls off by 5-60 µm",
            Self::Bowed => "plate bowed by its clamps, 10-50 µm",
            Self::FastScatter => "fast touches scatter by 6 µm",
        }
    }

    /// Whether the whole session is spoilt, and not one clamping of it.
    #[must_use]
    pub const fn lasts(self) -> bool {
        matches!(
            self,
            Self::Late
                | Self::OffsetMoved
                | Self::OldBeforeTeaching
                | Self::TeachingRefused
                | Self::OtherOrder
                | Self::BentStylus
                | Self::ZScale
                | Self::ShiftActive
                | Self::OtherLength
        )
    }

    /// Whether the text of one clamping is damaged, and nothing else.
    #[must_use]
    pub const fn is_of_text(self) -> bool {
        matches!(
            self,
            Self::LineTwice
                | Self::DigitChanged
                | Self::CharacterLost
                | Self::LineLost
                | Self::LinesSwapped
                | Self::SignLost
                | Self::BallLost
        )
    }
}
