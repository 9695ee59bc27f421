use super::*;

const XYZ: &[&[&str; 3]] = &[&["x", "y", "z"], &SOURCE, &TARGET];

fn read(text: &str) -> Result<Vec<[f64; 3]>, BadRow> {
    parse(text, XYZ)
}

/// Line and words of a refusal.
fn refusal(text: &str) -> (usize, String) {
    let problem = read(text).unwrap_err();
    (problem.line, problem.what.to_string())
}

/// Separators, line ends, comments, headers and quotes change nothing of the points.
#[test]
fn the_same_points_in_many_dresses() {
    for text in [
        "1,2.5,-3\n4,5,6e-3\n",
        "1;2.5;-3\r\n4;5;6e-3\r\n",
        "1\t2.5\t-3\n4\t5\t6e-3",
        "  1   2.5 -3\n 4 5\t6e-3 \n",
        "# made by hand\n\n1, 2.5, -3 # top\n4,5,.006\n",
        "x,y,z\n1,2.5,-3\n4,5,6e-3",
        "\"X [mm]\";\"Y [mm]\";\"Z [mm]\"\n1;2.5;-3\n4;5;6e-3",
        "x_mm,y_mm,z_mm\n1,2.5,-3\n4,5,6e-3",
        "px py pz\n1 2.5 -3\n4 5 6e-3",
        "qx,qy,qz\n1,2.5,-3\n4,5,6e-3",
        "east,north,up\n1,2.5,-3\n4,5,6e-3",
        "+1,+2.5,-3.0\n4.,5.0,0.006",
    ] {
        let points = read(text).unwrap();
        assert_eq!(points, [[1.0, 2.5, -3.0], [4.0, 5.0, 0.006]], "{text:?}");
    }
}

/// The first line decides by name which column is which, in any order.
#[test]
fn named_columns_may_stand_anywhere() {
    let points = read("Index,Z,feed,X,Y\n1,3,100,1,2\n2,6,100,4,5\n").unwrap();
    assert_eq!(points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
}

/// Nothing but comments is an empty list, for the fit to refuse.
#[test]
fn an_empty_file_is_an_empty_list() {
    for text in ["", "\n\n", "# nothing\n", "x,y,z\n"] {
        assert_eq!(read(text).unwrap(), [[0.0; 3]; 0], "{text:?}");
    }
}

/// NaN and infinity are numbers here; the fit refuses them by name.
#[test]
fn what_is_not_finite_passes_through() {
    let points = read("nan,inf,-inf\nNaN,1,Infinity").unwrap();
    assert!(points[0][0].is_nan());
    assert_eq!(points[0][1..], [f64::INFINITY, f64::NEG_INFINITY]);
    assert!(points[1][0].is_nan() && points[1][2].is_infinite());
}

/// Every line that is not understood is named by its number, with what is wrong.
#[test]
fn bad_lines_are_named() {
    for (text, line, words) in [
        ("1,2,3\n4,5\n", 2, "2 columns where 3 are due"),
        ("1,2,3\n\n# c\n4,5,6,7\n", 4, "4 columns where 3 are due"),
        ("0,1,2,3\n", 1, "name the columns"),
        (
            "i,x,y,z\n1,2,3\n",
            2,
            "3 columns where the first line names 4",
        ),
        ("1,2,3\n4,,6\n", 2, "column 2 is empty"),
        ("1,2,3\n4,5,six\n", 2, "`six` in column 3 is not a number"),
        ("1,2,3\nx,y,z\n", 2, "`x` in column 1 is not a number"),
        ("1;2;3\n4,5;6;7\n", 2, "`4,5` in column 1 has a comma"),
        ("1,2,- 3\n", 1, "`- 3` in column 3 is not a number"),
    ] {
        let (at, what) = refusal(text);
        assert_eq!(at, line, "{text:?}: {what}");
        assert!(what.contains(words), "{text:?}: {what}");
    }
}

/// A damaged first point does not pass for column names, nor do names that lack
/// an axis, name one twice or have another unit.
#[test]
fn bad_headers_are_named() {
    for (text, words) in [
        ("1O.5,l2.5,O7\n1,2,3\n", "neither numbers nor names"),
        ("point list\n1 2 3\n", "neither numbers nor names"),
        ("x,y\n1,2\n", "no `z`"),
        ("x,y,z,x\n1,2,3,4\n", "`x` is named twice"),
        ("x[inch],y[inch],z[inch]\n1,2,3\n", "not in mm"),
        ("x_um,y_um,z_um\n1,2,3\n", "not in mm"),
    ] {
        let (at, what) = refusal(text);
        assert_eq!(at, 1, "{text:?}: {what}");
        assert!(what.contains(words), "{text:?}: {what}");
    }
}

/// A decimal comma is never taken for a column: `1,5;2,5;3,5` is not six numbers.
#[test]
fn decimal_commas_do_not_make_pairs() {
    let pairs: &[&[&str; 6]] = &[&["px", "py", "pz", "qx", "qy", "qz"]];
    for text in [
        "1,5;2,5;3,5",
        "1,5;2,5;3,5;4,5;5,5;6,5",
        "1,5 2,5 3,5 4,5 5,5 6,5",
    ] {
        assert!(parse(text, pairs).is_err(), "{text}");
    }
    let row = parse("1;2;3;4;5;6", pairs).unwrap();
    assert_eq!(row, [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]);
}
