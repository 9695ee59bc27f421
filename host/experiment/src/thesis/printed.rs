//! Figures that A. Sawula's thesis prints (2013), for comparison. Table numbers are
//! the thesis'.

/// Table 4.1: the hits on sphere 3 of case 0, mm: top, +X, -X, +Y, -Y.
pub const SPHERE_HITS_MM: [[f64; 3]; 5] = [
    [-136.7110, 136.4120, 148.8330],
    [-124.0060, 136.4140, 136.1330],
    [-149.4150, 136.4140, 136.1330],
    [-136.7120, 149.1310, 136.1330],
    [-136.7120, 123.6930, 136.1330],
];

/// Table 4.1: the fitted centre, mm.
pub const SPHERE_CENTER_MM: [f64; 3] = [-136.7105, 136.4120, 136.1212];

/// Table 4.2, one clamping.
pub struct PublishedRegistration {
    /// Transformed less measured centre of each sphere, mm.
    pub errors_mm: [[f64; 3]; 3],
    /// R by rows.
    pub rotation: [[f64; 3]; 3],
    /// T, mm.
    pub translation_mm: [f64; 3],
}

/// Table 4.2: cases 1 to 4.
pub const REGISTRATIONS: [PublishedRegistration; 4] = [
    PublishedRegistration {
        errors_mm: [
            [-0.0022, 0.0148, 0.0002],
            [0.0070, -0.0049, -0.0006],
            [-0.0049, -0.0098, 0.0005],
        ],
        rotation: [
            [0.9999, -0.0173, -0.0002],
            [0.0173, 0.9999, 0.0],
            [0.0002, 0.0, 1.0],
        ],
        translation_mm: [-0.8700, -0.5866, 0.0060],
    },
    PublishedRegistration {
        errors_mm: [
            [0.0011, 0.0053, -0.0001],
            [0.0085, -0.0098, -0.0008],
            [-0.0096, 0.0045, 0.0009],
        ],
        rotation: [
            [0.9999, 0.0157, -0.0001],
            [-0.0157, 0.9999, 0.0],
            [0.0001, 0.0, 1.0],
        ],
        translation_mm: [16.6543, -0.6807, 0.0117],
    },
    PublishedRegistration {
        errors_mm: [
            [-0.0114, 0.0029, 0.0011],
            [0.0182, -0.0064, -0.0017],
            [-0.0067, 0.0036, 0.0006],
        ],
        rotation: [
            [1.0, -0.0062, -0.0002],
            [0.0062, 1.0, 0.0],
            [0.0002, 0.0, 1.0],
        ],
        translation_mm: [-48.4372, -1.9574, 0.0219],
    },
    PublishedRegistration {
        errors_mm: [
            [-0.0113, 0.0046, 0.0011],
            [0.0087, 0.0026, -0.0008],
            [0.0026, -0.0072, -0.0003],
        ],
        rotation: [
            [0.9993, 0.0377, 0.0],
            [-0.0377, 0.9993, 0.0002],
            [0.0, -0.0002, 1.0],
        ],
        translation_mm: [-35.1846, -0.2768, -0.0090],
    },
];

/// Deviations of the finished surface as the thesis reports them: mean of those above
/// nominal, mean of those below, standard deviation, mm.
pub struct PublishedSurface {
    /// Where it stands.
    pub place: &'static str,
    /// Mean of the positive deviations, mm.
    pub above_mm: f64,
    /// Mean of the negative deviations, mm.
    pub below_mm: f64,
    /// Standard deviation, mm.
    pub std_mm: f64,
}

/// The two scans of the finished workpiece: cases 1 to 4 against the arc that was fitted
/// to the scan of case 0 (section 5.1). The conclusions (chapter 7) repeat the second.
pub const SURFACES: [PublishedSurface; 2] = [
    PublishedSurface {
        place: "table 5.1, Roland scan",
        above_mm: 0.011,
        below_mm: -0.021,
        std_mm: 0.021,
    },
    PublishedSurface {
        place: "table 6.3, LMI scan",
        above_mm: 0.010,
        below_mm: -0.022,
        std_mm: 0.019,
    },
];

/// Table 5.2: radius, standard deviation of the residuals and "uncertainty of centre" of
/// spheres 1 to 3 in cases 0 to 4, mm.
pub const SPHERES_MM: [[[f64; 3]; 3]; 5] = [
    [
        [12.7130, 0.0150, 0.0075],
        [12.7130, 0.0150, 0.0075],
        [12.7118, 0.0145, 0.0073],
    ],
    [
        [12.7153, 0.0065, 0.0033],
        [12.7140, 0.0130, 0.0065],
        [12.7133, 0.0145, 0.0073],
    ],
    [
        [12.7125, 0.0130, 0.0065],
        [12.7145, 0.0150, 0.0075],
        [12.7128, 0.0155, 0.0078],
    ],
    [
        [12.7160, 0.0100, 0.0050],
        [12.7143, 0.0155, 0.0078],
        [12.7113, 0.0155, 0.0078],
    ],
    [
        [12.7133, 0.0125, 0.0063],
        [12.7160, 0.0130, 0.0065],
        [12.7130, 0.0130, 0.0065],
    ],
];

/// Table 5.2: the averages of its columns, mm.
pub const SPHERES_AVERAGE_MM: [f64; 3] = [12.7136, 0.0134, 0.0067];

/// Table 5.3: distances of spheres 1-2, 1-3 and 2-3 in cases 0 to 4, mm. They are
/// distances in plan: only so do they agree with table 4.2.
pub const DISTANCES_MM: [[f64; 3]; 5] = [
    [273.0136, 273.0408, 385.9398],
    [273.0094, 273.0653, 385.9373],
    [273.0097, 273.0416, 385.9195],
    [272.9890, 273.0402, 385.9184],
    [272.9935, 273.0522, 385.9466],
];

/// Table 5.3: "difference from case 0", mm. Two of them, 0.0009 and 0.0115, are not the
/// differences of the printed distances: those were not yet rounded.
pub const DISTANCE_CHANGES_MM: [[f64; 3]; 5] = [
    [0.0, 0.0, 0.0],
    [-0.0042, 0.0245, -0.0025],
    [-0.0039, 0.0009, -0.0203],
    [-0.0246, -0.0006, -0.0214],
    [-0.0201, 0.0115, 0.0068],
];

/// Table 5.4, one clamping.
pub struct PublishedPlane {
    /// Centroid, mm.
    pub centroid_mm: [f64; 3],
    /// Direction cosines of the normal.
    pub normal: [f64; 3],
    /// Standard deviation of the residuals, mm.
    pub std_mm: f64,
}

/// Table 5.4: the plate's surface in cases 0 to 4.
pub const PLANES: [PublishedPlane; 5] = [
    PublishedPlane {
        centroid_mm: [0.5890, 1.5120, 63.9985],
        normal: [0.0, 0.0, 1.0],
        std_mm: 0.0160,
    },
    PublishedPlane {
        centroid_mm: [3.2840, 1.9350, 63.9987],
        normal: [-0.0001, 0.0, 1.0],
        std_mm: 0.0167,
    },
    PublishedPlane {
        centroid_mm: [18.6880, -6.5650, 63.9989],
        normal: [-0.0001, 0.0, 1.0],
        std_mm: 0.0175,
    },
    PublishedPlane {
        centroid_mm: [-46.8100, -6.8000, 64.0005],
        normal: [-0.0001, 0.0001, 1.0],
        std_mm: 0.0189,
    },
    PublishedPlane {
        centroid_mm: [-33.5140, -7.3950, 64.0017],
        normal: [-0.0001, 0.0001, 1.0],
        std_mm: 0.0182,
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    /// What is quoted holds together as far as printed digits can: averages, halves
    /// and differences are within the last digit of what they are made of.
    #[test]
    fn tables_hold_together() {
        for (column, average) in SPHERES_AVERAGE_MM.iter().enumerate() {
            let sum: f64 = SPHERES_MM.iter().flatten().map(|row| row[column]).sum();
            assert!((sum / 15.0 - average).abs() < 1e-4, "{column}");
        }
        for [_, std_mm, half_mm] in SPHERES_MM.iter().flatten() {
            assert!((std_mm / 2.0 - half_mm).abs() < 0.51e-4, "{half_mm}");
        }
        for (distances, changes) in DISTANCES_MM.iter().zip(&DISTANCE_CHANGES_MM) {
            for (pair, change) in changes.iter().enumerate() {
                let difference = distances[pair] - DISTANCES_MM[0][pair];
                assert!((difference - change).abs() < 1.01e-4, "{change}");
            }
        }
        let [x, y, z] = SPHERE_CENTER_MM;
        let [_, right, left, back, front] = SPHERE_HITS_MM;
        assert!((f64::midpoint(right[0], left[0]) - x).abs() < 1e-4);
        assert!((f64::midpoint(back[1], front[1]) - y).abs() < 1e-4);
        assert!((SPHERE_HITS_MM[0][2] - SPHERES_MM[0][2][0] - z).abs() < 1e-4);
    }
}
