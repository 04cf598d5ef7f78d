//! Random assets from a seed.

use half::f16;
use lightkiln_format::lighting::Light;
use lightkiln_format::prm::{LANES, Prm, ROW};

/// SplitMix64 (Steele, Lea, Flood 2014).
pub struct Random(pub u64);

impl Random {
    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A whole number below `bound`.
    pub fn below(&mut self, bound: usize) -> usize {
        (self.bits() % bound as u64) as usize
    }

    /// Uniform in `[from, to)`.
    pub fn uniform(&mut self, from: f32, to: f32) -> f32 {
        from + (to - from) * (self.bits() >> 40) as f32 / (1 << 24) as f32
    }

    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> [f32; 3] {
        on_sphere([self.uniform(0.0, 1.0), self.uniform(0.0, 1.0)])
    }
}

/// The area-preserving map of the unit square to the unit sphere.
pub fn on_sphere([u, v]: [f32; 2]) -> [f32; 3] {
    let z = 1.0 - 2.0 * u;
    let (sin, cos) = (v * std::f32::consts::TAU).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    [r * cos, r * sin, z]
}

/// A valid map of `points` reference points on `pages` pages, in a room of some metres.
pub fn prm(seed: u64, points: usize, cells: usize, pages: usize) -> Prm {
    let random = &mut Random(seed);
    let mut prm = Prm {
        origin: [120.5, -3.25, 7e3],
        ..Prm::default()
    };
    let per_page = points.div_ceil(pages);
    for page in 0..pages {
        let width = 8 + 3 * page as u32;
        // A third more texels than points: fills, and texels without a value.
        prm.pages.push([
            width,
            (per_page * 4).div_ceil(3 * width as usize) as u32 + 1,
        ]);
    }
    prm.cell_entries.push(0);
    for cell in 0..cells {
        for _ in 0..1 + (cell + random.below(3)) % 5 {
            prm.entry_position
                .push([0; 3].map(|_: i32| random.uniform(-3.0, 3.0)));
            prm.entry_normal.push(random.direction());
        }
        prm.cell_entries.push(prm.entry_position.len() as u32);
    }
    for point in 0..points {
        let (page, i) = (point / per_page, point % per_page);
        let width = prm.pages[page][0] as usize;
        prm.point_texel
            .push([page as u16, (i % width) as u16, (i / width) as u16, 0]);
    }
    for (page, &[width, height]) in prm.pages.iter().enumerate() {
        let used = per_page.min(points.saturating_sub(page * per_page)) as u32;
        for i in used..(width * height).min(used + per_page as u32 / 8) {
            let source = random.below(points) as u32;
            prm.fill.push([page as u32, i % width, i / width, source]);
        }
    }
    prm.block_rows.push(0);
    for block in 0..prm.blocks() {
        let lanes = LANES.min(points - block * LANES);
        for cell in 0..cells {
            if random.below(3) == 0 {
                continue;
            }
            prm.row_cell.push(cell as u16);
            for i in 0..ROW {
                let value = if i % LANES < lanes {
                    random.uniform(0.0, 0.1)
                } else {
                    0.0
                };
                prm.row_response.push(f16::from_f32(value));
            }
        }
        prm.block_rows.push(prm.row_cell.len() as u32);
    }
    prm
}

/// `count` lamps of every supported kind about `origin`.
pub fn lights(seed: u64, count: usize, origin: [f64; 3]) -> Vec<Light> {
    let random = &mut Random(seed);
    let light = |i| {
        let position = origin
            .map(|o| o + f64::from(random.uniform(-2.0, 2.0)))
            .into();
        let power = [0; 3].map(|_: i32| random.uniform(0.0, 20.0)).into();
        let direction = random.direction().into();
        match i % 3 {
            0 => Light::Point {
                position,
                intensity: power,
                radius: random.uniform(0.0, 0.1),
            },
            1 => Light::Spot {
                position,
                direction,
                intensity: power,
                inner_cone: random.uniform(0.0, 0.5),
                outer_cone: random.uniform(0.6, 1.5),
                radius: 0.02,
            },
            _ => Light::Directional {
                direction,
                irradiance: power,
            },
        }
    };
    (0..count).map(light).collect()
}
