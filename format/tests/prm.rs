//! Rules, round trip and arithmetic of precomputed radiance maps.

use crate::random::{self, Random};
use half::f16;
use lightkiln_format::lighting::Light;
use lightkiln_format::prm::{EvaluateError, LANES, Prm, ROW};

#[test]
fn what_is_written_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("prm.safetensors");
    for (seed, points) in [(1, 150), (2, 64), (3, 1), (4, 0)] {
        let prm = random::prm(seed, points, 7, 3);
        let written = prm.write(&path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(written.bytes, bytes.len() as u64);
        assert_eq!(written.blake3, blake3::hash(&bytes));
        assert_eq!(Prm::read(&path).unwrap(), prm);
        prm.write(&path).unwrap();
        assert_eq!(
            std::fs::read(&path).unwrap(),
            bytes,
            "the same map gives the same bytes"
        );
    }
    let names: Vec<_> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|e| e.unwrap())
        .collect();
    assert_eq!(names.len(), 1, "temporary files stay: {names:?}");
}

#[test]
fn a_failed_write_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    // A folder in the way: the rename fails after all has been written.
    let path = folder.path().join("prm.safetensors");
    std::fs::create_dir(&path).unwrap();
    let error = random::prm(1, 10, 2, 1)
        .write(&path)
        .unwrap_err()
        .to_string();
    assert!(error.contains("prm.safetensors"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// Each way to break a map, the array that must be named and the element.
#[test]
fn every_rule_names_its_array_and_element() {
    type Break = fn(&mut Prm);
    let breaks: &[(&str, usize, Break)] = &[
        ("origin", 1, |p| p.origin[1] = f64::NAN),
        ("pages", 2, |p| p.pages[2] = [0, 4]),
        ("pages", 1, |p| p.pages[1] = [4, 1 << 20]),
        ("entry_position", 3, |p| {
            p.entry_position[3][2] = f32::INFINITY
        }),
        ("entry_normal", 2, |p| p.entry_normal[2] = [0.0; 3]),
        ("entry_normal", 0, |p| p.entry_normal[0][0] = f32::NAN),
        ("cell_entries", 0, |p| p.cell_entries[0] = 1),
        ("cell_entries", 3, |p| p.cell_entries[3] = p.cell_entries[2]),
        ("cell_entries", 7, |p| {
            *p.cell_entries.last_mut().unwrap() += 1
        }),
        ("cell_entries", 0, |p| p.cell_entries.clear()),
        ("point_texel", 9, |p| p.point_texel[9][0] = 3),
        ("point_texel", 9, |p| p.point_texel[9][1] = 999),
        ("point_texel", 9, |p| p.point_texel[9][3] = 2),
        ("point_texel", 9, |p| p.point_texel[9] = p.point_texel[8]),
        ("block_rows", 2, |p| p.block_rows[1] = u32::MAX),
        ("block_rows", 3, |p| p.block_rows.truncate(3)),
        ("row_cell", 5, |p| p.row_cell[5] = 7),
        ("row_response", 77, |p| p.row_response[77] = f16::NAN),
        ("row_response", 77, |p| p.row_response[77] = f16::INFINITY),
        ("row_response", 77, |p| {
            p.row_response[77] = f16::from_f32(-0.5)
        }),
        ("fill", 0, |p| p.fill[0][3] = 150),
        ("fill", 0, |p| p.fill[0][2] = 999),
    ];
    for (i, (array, index, change)) in breaks.iter().enumerate() {
        let mut prm = random::prm(1, 150, 7, 3);
        prm.validate().unwrap();
        change(&mut prm);
        let error = prm.validate().unwrap_err();
        assert_eq!(error.array, *array, "break {i}: {error}");
        assert_eq!(error.index, *index, "break {i}: {error}");
    }
    let mut prm = random::prm(1, 150, 7, 3);
    *prm.row_response.last_mut().unwrap() = f16::ONE;
    let error = prm.validate().unwrap_err();
    assert_eq!(
        (error.array, error.index),
        ("row_response", prm.row_response.len() - 1)
    );
}

/// The sums of the definition, written plainly in f64.
#[test]
fn evaluation_is_the_sum_over_cells() {
    let prm = random::prm(5, 200, 11, 2);
    let lights = random::lights(6, 5, prm.origin);
    let random = &mut Random(7);
    let entries = prm.entry_position.len();
    let visibility: Vec<_> = (0..lights.len() * entries)
        .map(|_| random.uniform(0.0, 1.0))
        .collect();
    let cells = prm.cell_irradiance(&lights, &visibility).unwrap();
    let points = prm.evaluate(&cells).unwrap();
    for (point, value) in points.iter().enumerate() {
        let (block, lane) = (point / LANES, point % LANES);
        for channel in 0..3 {
            let rows = prm.block_rows[block] as usize..prm.block_rows[block + 1] as usize;
            let term = |row: usize| {
                let response = prm.row_response[row * ROW + channel * LANES + lane];
                response.to_f64() * f64::from(cells[usize::from(prm.row_cell[row])][channel])
            };
            let exact: f64 = rows.map(term).sum();
            // 11 products and sums, each rounded to 2^-24.
            let bound = exact * 22.0 / f64::from(1 << 24);
            assert!((f64::from(value[channel]) - exact).abs() <= bound);
        }
    }
    let pages = prm.lightmap(&points).unwrap();
    for (point, &[page, x, y, _]) in prm.point_texel.iter().enumerate() {
        let width = prm.pages[usize::from(page)][0] as usize;
        let texel = pages[usize::from(page)][usize::from(y) * width + usize::from(x)];
        assert_eq!(texel, points[point]);
    }
    for &[page, x, y, source] in &prm.fill {
        let width = prm.pages[page as usize][0];
        assert_eq!(
            pages[page as usize][(y * width + x) as usize],
            points[source as usize]
        );
    }
}

#[test]
fn cells_average_their_entries_and_lights_add() {
    let prm = random::prm(8, 10, 5, 1);
    let entries = prm.entry_position.len();
    let lights = random::lights(9, 3, prm.origin);
    let all = prm
        .cell_irradiance(&lights, &vec![1.0; 3 * entries])
        .unwrap();
    let single = |i: usize| {
        prm.cell_irradiance(&lights[i..=i], &vec![1.0; entries])
            .unwrap()
    };
    let singles = [single(0), single(1), single(2)];
    for (cell, sum) in all.iter().enumerate() {
        for channel in 0..3 {
            let expected: f32 = singles.iter().map(|s| s[cell][channel]).sum();
            assert!((sum[channel] - expected).abs() <= 1e-5 * expected);
        }
    }
    let dark = prm
        .cell_irradiance(&lights, &vec![0.0; 3 * entries])
        .unwrap();
    assert!(dark.iter().all(|e| *e == [0.0; 3]));
}

#[test]
fn wrong_lengths_and_ranges_are_errors() {
    let prm = random::prm(10, 70, 4, 1);
    let entries = prm.entry_position.len();
    let lights = random::lights(11, 1, prm.origin);
    let visibility = |v: &[f32]| match prm.cell_irradiance(&lights, v).unwrap_err() {
        EvaluateError::Input(e) => (e.array, e.index),
        other => panic!("{other}"),
    };
    assert_eq!(visibility(&[]), ("visibility", 0));
    let mut values = vec![1.0; entries];
    values[2] = f32::NAN;
    assert_eq!(visibility(&values), ("visibility", 2));
    assert_eq!(prm.evaluate(&[]).unwrap_err().array, "cell_irradiance");
    assert_eq!(prm.lightmap(&[]).unwrap_err().array, "point_values");
    let rectangle = Light::Rectangle {
        position: [0.0; 3].into(),
        half_u: [1.0, 0.0, 0.0].into(),
        half_v: [0.0, 1.0, 0.0].into(),
        radiance: [1.0; 3].into(),
    };
    let error = prm
        .cell_irradiance(&[rectangle], &vec![1.0; entries])
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("rectangle") && error.contains("light 0"),
        "{error}"
    );
}
