#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use nalgebra::Point3;
use rand::RngExt;

use crate::parse;

const POINTS: [[f32; 3]; 3] = [[1.0, -2.5, 3.25], [f32::NAN, 0.0, 0.0], [0.125, 4.0, -1e3]];

fn same(found: &[Point3<f64>]) {
    assert_eq!(found.len(), 3);
    for (f, p) in found.iter().zip(POINTS) {
        for k in 0..3 {
            let (a, b) = (f[k], f64::from(p[k]));
            assert!(a == b || (a.is_nan() && b.is_nan()), "{a} is not {b}");
        }
    }
}

fn ply(format: &str) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {format} 1.0\ncomment made up\nelement face 1\nproperty list uchar int vertex_indices\nelement vertex 3\n\
         property uchar red\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    )
    .into_bytes();
    match format {
        "ascii" => {
            bytes.extend(b"3 0 1 2\n");
            for p in POINTS {
                bytes.extend(format!("7 {} {} {}\n", p[0], p[1], p[2]).bytes());
            }
        }
        _ => {
            let little = format == "binary_little_endian";
            let word = |b: [u8; 4]| if little { b } else { [b[3], b[2], b[1], b[0]] };
            bytes.push(3);
            (0..3_i32).for_each(|i| bytes.extend(word(i.to_le_bytes())));
            for p in POINTS {
                bytes.push(7);
                p.iter().for_each(|c| bytes.extend(word(c.to_le_bytes())));
            }
        }
    }
    bytes
}

fn pcd(data: &str) -> Vec<u8> {
    let mut bytes = format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 3\n\
         HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA {data}\n"
    )
    .into_bytes();
    match data {
        "ascii" => POINTS.iter().for_each(|p| bytes.extend(format!("{} {} {} 255\n", p[0], p[1], p[2]).bytes())),
        "binary" => {
            for p in POINTS {
                p.iter().for_each(|c| bytes.extend(c.to_le_bytes()));
                bytes.extend([0; 4]);
            }
        }
        _ => {
            let mut columns: Vec<u8> = (0..3).flat_map(|k| POINTS.iter().flat_map(move |p| p[k].to_le_bytes())).collect();
            columns.extend([0; 12]);
            // The trailing zeros as one literal and a copy of itself; the rest as literals.
            let mut packed = Vec::new();
            for run in columns[..37].chunks(32) {
                packed.push(run.len() as u8 - 1);
                packed.extend(run);
            }
            packed.extend([7 << 5, 2, 0]);
            bytes.extend((packed.len() as u32).to_le_bytes());
            bytes.extend((columns.len() as u32).to_le_bytes());
            bytes.extend(packed);
        }
    }
    bytes
}

fn all() -> Vec<Vec<u8>> {
    let plys = ["ascii", "binary_little_endian", "binary_big_endian"].map(ply);
    plys.into_iter().chain(["ascii", "binary", "binary_compressed"].map(pcd)).collect()
}

#[test]
fn every_form_gives_the_same_points_in_order_with_those_that_are_not_finite() {
    for bytes in all() {
        same(&parse(&bytes).unwrap());
    }
}

#[test]
fn a_file_cut_off_anywhere_is_an_error_and_never_a_panic() {
    for bytes in all() {
        let text = bytes.windows(10).any(|w| w == b"DATA ascii") || bytes.windows(12).any(|w| w == b"format ascii");
        for length in 0..bytes.len() {
            // A text whose last number lost digits still reads; what may not happen is fewer points.
            match parse(&bytes[..length]) {
                Ok(points) => assert!(text && points.len() == 3, "{length} of {} bytes were taken for a whole cloud", bytes.len()),
                Err(e) => assert!(!e.message.is_empty()),
            }
        }
    }
}

#[test]
fn a_header_that_lies_about_its_count_is_refused_with_both_numbers() {
    for (from, to) in [("element vertex 3", "element vertex 4000000000"), ("element vertex 3", "element vertex 18446744073709551615")] {
        for form in ["ascii", "binary_little_endian"] {
            let bytes = ply(form);
            let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
            let lying = [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat();
            let message = parse(&lying).unwrap_err().message;
            assert!(message.contains("cut off") && message.contains(to.split(' ').next_back().unwrap()), "{message}");
            assert!(message.ends_with("but holds 3"), "{message}");
        }
    }
    for data in ["ascii", "binary"] {
        let bytes = pcd(data);
        let at = bytes.windows(5).position(|w| w == b"DATA ").unwrap();
        let header = String::from_utf8_lossy(&bytes[..at]).replace("POINTS 3", "POINTS 4000000000").replace("WIDTH 3", "WIDTH 4000000000");
        let message = parse(&[header.as_bytes(), &bytes[at..]].concat()).unwrap_err().message;
        assert!(message.ends_with("says that it has 4000000000 points, but holds 3"), "{message}");
    }
    let bytes = pcd("binary");
    let text = String::from_utf8_lossy(&bytes).replace("POINTS 3", "POINTS 900").replace("WIDTH 3", "WIDTH 900");
    assert!(parse(text.as_bytes()).unwrap_err().message.contains("900"));
}

#[test]
fn bytes_changed_at_random_never_panic() {
    let mut random = rand_pcg::Pcg64::new(1, 2);
    for bytes in all() {
        for _ in 0..2000 {
            let mut changed = bytes.clone();
            for _ in 0..3 {
                let at = random.random_range(0..changed.len());
                changed[at] = random.random();
            }
            let _ = parse(&changed);
        }
    }
}

#[test]
fn what_is_written_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("parts.ply");
    let points: Vec<Point3<f64>> = POINTS.iter().map(|p| Point3::from(p.map(f64::from))).collect();
    crate::write_parts(&path, &points, &[0, -1, 2]).unwrap();
    same(&crate::read(&path).unwrap());
}

#[test]
fn a_header_that_keeps_points_back_is_caught() {
    let few = |bytes: Vec<u8>, from: &str, to: &str| {
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    };
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let lying = few(ply(format), "vertex 3", "vertex 2");
        assert!(parse(&lying).unwrap_err().message.contains("says 2 points"), "{format}");
    }
    for data in ["ascii", "binary"] {
        let lying = few(few(pcd(data), "POINTS 3", "POINTS 2"), "WIDTH 3", "WIDTH 2");
        assert!(parse(&lying).unwrap_err().message.contains("says 2 points"), "{data}");
    }
}

#[test]
fn numbers_that_are_none_are_read_as_such_however_they_are_written() {
    for word in ["nan", "NaN", "-nan", "-nan(ind)", "1.#QNAN", "-1.#IND"] {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 {word} 2\n"
        );
        assert!(parse(text.as_bytes()).unwrap()[0].y.is_nan(), "{word}");
    }
}
