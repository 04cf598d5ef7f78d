//! Wavefront OBJ: polygons by group and material, with the MTL libraries they name.
//!
//! Parsed here rather than by a crate: messages need line numbers, positions need f64, faces may mix
//! corners with and without normals, and no malformed MTL value may panic.

mod mtl;
mod polygon;

use super::loaded::{Loaded, Part};
use super::resource::read_file;
use crate::error::{Error, Result};
use glam::{DVec3, Vec2, Vec3};
use mtl::Library;
use std::collections::HashMap;
use std::path::Path;
use std::str::SplitWhitespace;

/// Reads an `.obj` file. Texture coordinates are turned to our convention (first row at `v = 0`).
///
/// # Errors
/// [`Error::Input`] with the line of a malformed number; [`Error::Io`] if the file cannot be read.
pub(super) fn load(file: &Path) -> Result<Loaded> {
    let bytes = read_file(file)?;
    let text = String::from_utf8_lossy(&bytes);
    let stem = file
        .file_stem()
        .map_or_else(|| "object".into(), |s| s.to_string_lossy());
    let mut parser = Parser {
        file,
        stem: stem.into_owned(),
        library: Library::new(file),
        loaded: Loaded::default(),
        positions: Vec::new(),
        uvs: Vec::new(),
        normals: Vec::new(),
        object: None,
        group: None,
        material: None,
        node: 0,
        open: HashMap::new(),
        bad_faces: 0,
        bad_attributes: 0,
    };
    let mut continued = String::new();
    for (number, line) in text.lines().enumerate() {
        if let Some(start) = line.strip_suffix('\\') {
            continued.push_str(start);
            continued.push(' ');
            continue;
        }
        if continued.is_empty() {
            parser.line(line, number + 1)?;
        } else {
            continued.push_str(line);
            parser.line(&std::mem::take(&mut continued), number + 1)?;
        }
    }
    parser.finish()
}

/// Vertex, texture coordinate and normal numbers of a face corner, from zero.
type Corner = (u32, Option<u32>, Option<u32>);

/// A part under construction.
#[derive(Default)]
struct Open {
    part: Part,
    vertices: HashMap<Corner, u32>,
}

struct Parser<'a> {
    file: &'a Path,
    stem: String,
    library: Library<'a>,
    loaded: Loaded,
    positions: Vec<DVec3>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    object: Option<String>,
    group: Option<String>,
    material: Option<u32>,
    node: usize,
    /// Parts of the current group, by material.
    open: HashMap<u32, Open>,
    bad_faces: u64,
    bad_attributes: u64,
}

impl Parser<'_> {
    fn line(&mut self, line: &str, number: usize) -> Result<()> {
        let line = line.trim();
        let Some(keyword) = line.split_whitespace().next() else {
            return Ok(());
        };
        let rest = line[keyword.len()..].trim();
        // Names may contain `#`; numbers may be followed by a comment.
        let words = rest
            .split('#')
            .next()
            .unwrap_or_default()
            .split_whitespace();
        match keyword {
            "v" => {
                let [x, y, z] = self.numbers(words, number)?;
                self.positions.push(DVec3::new(x, y, z));
            }
            "vt" => {
                // `v` is optional in one-dimensional textures.
                let [u, v] = self.numbers(words.chain(["0"]), number)?;
                self.uvs.push(Vec2::new(u as f32, (1.0 - v) as f32));
            }
            "vn" => {
                let n: [f64; 3] = self.numbers(words, number)?;
                self.normals.push(DVec3::from(n).as_vec3());
            }
            "f" => self.face(words, number)?,
            "o" if self.object.as_deref() != Some(rest) => {
                self.close()?;
                (self.object, self.group) = (Some(rest.to_owned()), None);
            }
            "g" if self.group.as_deref() != Some(rest) => {
                self.close()?;
                self.group = Some(rest.to_owned());
            }
            "usemtl" => self.material = Some(self.library.find(rest, &mut self.loaded)),
            "mtllib" => self.library.read(rest, &mut self.loaded),
            _ => {}
        }
        Ok(())
    }

    fn numbers<'a, const N: usize>(
        &self,
        mut words: impl Iterator<Item = &'a str>,
        line: usize,
    ) -> Result<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            let number = words.next().and_then(|w| w.parse().ok());
            *value = number.ok_or_else(|| {
                let problem = format!("needs {N} numbers");
                Error::input(
                    self.file,
                    format!("line {line}"),
                    problem,
                    "correct the line",
                )
            })?;
        }
        Ok(values)
    }

    fn face(&mut self, words: SplitWhitespace<'_>, line: usize) -> Result<()> {
        let mut corners: Vec<Corner> = Vec::new();
        let mut whole = true;
        for word in words {
            let mut numbers = word.split('/');
            let mut next = |count: usize| -> Result<Option<u32>> {
                let Some(number) = numbers.next().filter(|n| !n.is_empty()) else {
                    return Ok(None);
                };
                let number: i64 = number.parse().map_err(|_| {
                    let problem = format!("`{word}` is no face corner");
                    let remedy = "write vertex/texture/normal numbers";
                    Error::input(self.file, format!("line {line}"), problem, remedy)
                })?;
                // From one, or backwards from the end; MAX stands for numbers that do not exist.
                let index = if number < 0 {
                    count as i64 + number
                } else {
                    number - 1
                };
                let exists = (0..count as i64).contains(&index);
                Ok(Some(
                    u32::try_from(index)
                        .ok()
                        .filter(|_| exists)
                        .unwrap_or(u32::MAX),
                ))
            };
            let vertex = next(self.positions.len())?;
            let uv = next(self.uvs.len())?;
            let normal = next(self.normals.len())?;
            let lost = [uv, normal]
                .iter()
                .filter(|&&i| i == Some(u32::MAX))
                .count();
            self.bad_attributes += lost as u64;
            let known = |i: Option<u32>| i.filter(|&i| i != u32::MAX);
            match known(vertex) {
                Some(vertex) => corners.push((vertex, known(uv), known(normal))),
                None => whole = false,
            }
        }
        if !whole || corners.len() < 3 {
            self.bad_faces += 1;
            return Ok(());
        }
        self.polygon(&corners);
        Ok(())
    }

    fn polygon(&mut self, corners: &[Corner]) {
        let material = match self.material {
            Some(material) => material,
            None => self.library.find("default", &mut self.loaded),
        };
        self.material = Some(material);
        let open = self.open.entry(material).or_default();
        let part = &mut open.part;
        let indices: Vec<u32> = corners
            .iter()
            .map(|corner| {
                *open.vertices.entry(*corner).or_insert_with(|| {
                    let (vertex, uv, normal) = *corner;
                    part.positions.push(self.positions[vertex as usize]);
                    part.uvs
                        .push(uv.map_or(Vec2::ZERO, |i| self.uvs[i as usize]));
                    part.normals
                        .push(normal.map_or(Vec3::NAN, |i| self.normals[i as usize]));
                    part.lightmap_uvs.push(Vec2::NAN);
                    part.positions.len() as u32 - 1
                })
            })
            .collect();
        if let &[a, b, c] = indices.as_slice() {
            part.triangles.push([a, b, c]);
            return;
        }
        let points: Vec<DVec3> = corners
            .iter()
            .map(|c| self.positions[c.0 as usize])
            .collect();
        for triangle in polygon::triangulate(&points) {
            part.triangles.push(triangle.map(|i| indices[i]));
        }
    }

    /// Ends the current group.
    fn close(&mut self) -> Result<()> {
        let names = [self.group.as_ref(), self.object.as_ref()];
        let mut path: Vec<String> = names.into_iter().flatten().cloned().collect();
        if path.is_empty() {
            path.push(self.stem.clone());
        }
        let mesh = path.last().cloned().unwrap_or_default();
        let mut open: Vec<(u32, Open)> = self.open.drain().collect();
        open.sort_unstable_by_key(|&(material, _)| material);
        for (material, Open { part, .. }) in open {
            let (node, path, mesh) = (self.node, path.clone(), mesh.clone());
            self.loaded.push(
                self.file,
                Part {
                    node,
                    path,
                    mesh,
                    material,
                    ..part
                },
            )?;
        }
        self.node += 1;
        Ok(())
    }

    fn finish(mut self) -> Result<Loaded> {
        self.close()?;
        let bad = [
            (
                self.bad_faces,
                "faces with fewer than three existing vertices are left out",
            ),
            (
                self.bad_attributes,
                "texture or normal numbers that do not exist are ignored",
            ),
        ];
        for (count, what) in bad.into_iter().filter(|&(count, _)| count > 0) {
            self.loaded.find("faces", what, count);
        }
        Ok(self.loaded)
    }
}
