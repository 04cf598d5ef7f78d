//! MTL material libraries: `Kd`, `Ke`, `d`, `Tr`, `map_Kd`, `map_Ke`, `map_d`.
//!
//! Colours are taken as linear, images as sRGB. A material without `Kd` is white under a texture and
//! [`GREY`] without one. A surface whose texture has an alpha channel, or that has `map_d` or
//! `d < 1`, is masked at one half, and then reflects on both sides: it is a sheet.

use crate::scene::loaded::Loaded;
use crate::scene::material::{Material, TextureRef, Wrap};
use crate::scene::resource::{beside, read_file, reason};
use crate::scene::texture::{Decoder, texture};
use glam::{Vec2, Vec3};
use image::RgbaImage;
use std::collections::HashMap;
use std::path::Path;

/// Albedo of a surface about whose colour the files say nothing.
const GREY: f32 = 0.8;

/// What the lines of one material said.
#[derive(Default)]
struct Raw {
    name: String,
    kd: Option<Vec3>,
    ke: Option<Vec3>,
    opacity: Option<f32>,
    map_kd: Option<Map>,
    map_ke: Option<Map>,
    map_d: Option<Map>,
}

/// A `map_` statement.
#[derive(Clone)]
struct Map {
    name: String,
    scale: Vec2,
    offset: Vec2,
    clamp: bool,
}

/// The materials known so far.
pub(super) struct Library<'a> {
    file: &'a Path,
    raw: HashMap<String, Raw>,
    known: HashMap<String, u32>,
    decoder: Decoder,
    /// Index and whether any texel is transparent, by the names of colour and mask.
    textures: HashMap<(String, String, bool), Option<(u32, bool)>>,
}

impl<'a> Library<'a> {
    /// Knows nothing yet; names are relative to `file`.
    pub fn new(file: &'a Path) -> Self {
        let (raw, known, textures) = (HashMap::new(), HashMap::new(), HashMap::new());
        Self {
            file,
            raw,
            known,
            decoder: Decoder::default(),
            textures,
        }
    }

    /// Reads the libraries of an `mtllib` line; one that cannot be read is reported.
    pub fn read(&mut self, names: &str, loaded: &mut Loaded) {
        let whole = beside(self.file, names);
        let names: Vec<&str> = if whole.is_file() {
            vec![names]
        } else {
            names.split_whitespace().collect()
        };
        for name in names {
            match read_file(&beside(self.file, name)) {
                Ok(bytes) => self.parse(&String::from_utf8_lossy(&bytes)),
                Err(e) => {
                    let what = format!("its materials are grey ({GREY}): {}", reason(&e));
                    loaded.find(format!("mtllib `{name}`"), what, 1);
                }
            }
        }
    }

    fn parse(&mut self, text: &str) {
        let mut raw = Raw::default();
        for line in text.lines().map(str::trim) {
            let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
            match keyword {
                "newmtl" => {
                    let new = Raw {
                        name: rest.trim().into(),
                        ..Raw::default()
                    };
                    let done = std::mem::replace(&mut raw, new);
                    self.raw.insert(done.name.clone(), done);
                }
                "Kd" => raw.kd = colour(rest),
                "Ke" => raw.ke = colour(rest),
                "d" => raw.opacity = number(rest),
                "Tr" => raw.opacity = number(rest).map(|t| 1.0 - t),
                "map_Kd" => raw.map_kd = Some(map(rest)),
                "map_Ke" => raw.map_ke = Some(map(rest)),
                "map_d" => raw.map_d = Some(map(rest)),
                _ => {}
            }
        }
        self.raw.insert(raw.name.clone(), raw);
    }

    /// The material of a name, added to `loaded` when first asked for.
    pub fn find(&mut self, name: &str, loaded: &mut Loaded) -> u32 {
        if let Some(&index) = self.known.get(name) {
            return index;
        }
        let raw = self.raw.remove(name).unwrap_or_default();
        let material = self.material(name, &raw, loaded);
        loaded.materials.push(material);
        loaded.material_roles.push(None);
        let index = loaded.materials.len() as u32 - 1;
        self.known.insert(name.into(), index);
        index
    }

    fn material(&mut self, name: &str, raw: &Raw, loaded: &mut Loaded) -> Material {
        let element = format!("material `{name}`");
        let colour = self.texture(raw.map_kd.as_ref(), raw.map_d.as_ref(), &element, loaded);
        let glow = self.texture(raw.map_ke.as_ref(), None, &element, loaded);
        let base_color = raw.kd.unwrap_or_else(|| {
            if colour.is_some() && raw.map_kd.is_some() {
                return Vec3::ONE;
            }
            loaded.find(&element, format!("has no colour: grey ({GREY})"), 1);
            Vec3::splat(GREY)
        });
        let alpha = raw.opacity.unwrap_or(1.0);
        let masked = alpha < 1.0 || colour.is_some_and(|(_, transparent)| transparent);
        if masked {
            let what = format!("masked by alpha at 0.5, both sides reflect (d = {alpha})");
            loaded.find(&element, what, 1);
        }
        let reference = |map: &Option<Map>, found: Option<(u32, bool)>| {
            let (index, _) = found?;
            let (scale, offset) = map
                .as_ref()
                .map_or((Vec2::ONE, Vec2::ZERO), |m| (m.scale, m.offset));
            // `v` runs downwards here and upwards in the file.
            let offset = Vec2::new(offset.x, 1.0 - scale.y - offset.y);
            let transform = [Vec2::X * scale.x, Vec2::Y * scale.y, offset];
            Some(TextureRef {
                transform,
                ..TextureRef::new(index)
            })
        };
        let emissive = raw.ke.unwrap_or(if glow.is_some() {
            Vec3::ONE
        } else {
            Vec3::ZERO
        });
        Material {
            name: name.into(),
            base_color,
            alpha,
            base_color_texture: reference(&raw.map_kd.clone().or(raw.map_d.clone()), colour),
            emissive,
            emissive_texture: reference(&raw.map_ke, glow),
            alpha_cutoff: masked.then_some(0.5),
            double_sided: masked,
            ..Material::default()
        }
    }

    /// Colour image with its own alpha or, where that is opaque throughout, with the mask's value.
    fn texture(
        &mut self,
        colour: Option<&Map>,
        mask: Option<&Map>,
        element: &str,
        loaded: &mut Loaded,
    ) -> Option<(u32, bool)> {
        let first = colour.or(mask)?;
        let name = |map: Option<&Map>| map.map(|m| m.name.clone()).unwrap_or_default();
        let key = (name(colour), name(mask), first.clamp);
        if let Some(&known) = self.textures.get(&key) {
            return known;
        }
        let [image, mask] =
            [colour, mask].map(|map| map.and_then(|m| self.image(&m.name, element, loaded)));
        let image = match (image, mask) {
            (Some(image), Some(mask)) if !transparent(&image) => Some(with_mask(image, &mask)),
            (None, Some(mask)) => {
                let white = RgbaImage::from_pixel(mask.width(), mask.height(), [255; 4].into());
                Some(with_mask(white, &mask))
            }
            (image, _) => image,
        };
        let found = image.map(|image| {
            let wrap = if first.clamp {
                Wrap::Clamp
            } else {
                Wrap::Repeat
            };
            loaded
                .textures
                .push(texture(first.name.clone(), &image, true, [wrap; 2]));
            (loaded.textures.len() as u32 - 1, transparent(&image))
        });
        self.textures.insert(key, found);
        found
    }

    fn image(&mut self, name: &str, element: &str, loaded: &mut Loaded) -> Option<RgbaImage> {
        let bytes = read_file(&beside(self.file, name)).map_err(|e| reason(&e));
        match bytes.and_then(|bytes| self.decoder.decode(&bytes)) {
            Ok(image) => Some(image),
            Err(problem) => {
                let what = format!("texture `{name}` is not used, the factor alone is: {problem}");
                loaded.find(element, what, 1);
                None
            }
        }
    }
}

/// Whether any texel is less than half there.
fn transparent(image: &RgbaImage) -> bool {
    image.pixels().any(|p| p.0[3] < 128)
}

/// The image with alpha from the mask's red channel (its alpha, where that varies).
fn with_mask(mut image: RgbaImage, mask: &RgbaImage) -> RgbaImage {
    let channel = if transparent(mask) { 3 } else { 0 };
    let (w, h) = image.dimensions();
    for (x, y, pixel) in image.enumerate_pixels_mut() {
        let scaled =
            |i: u32, from: u32, to: u32| (u64::from(i) * u64::from(to) / u64::from(from)) as u32;
        pixel.0[3] = mask
            .get_pixel(scaled(x, w, mask.width()), scaled(y, h, mask.height()))
            .0[channel];
    }
    image
}

fn number(text: &str) -> Option<f32> {
    text.split_whitespace()
        .find(|w| *w != "-halo")?
        .parse()
        .ok()
        .filter(|n: &f32| n.is_finite())
}

/// Red, green and blue; one number alone stands for all three.
fn colour(text: &str) -> Option<Vec3> {
    let numbers: Vec<f32> = text
        .split_whitespace()
        .map_while(|w| w.parse().ok())
        .take(3)
        .collect();
    let colour = match numbers.as_slice() {
        &[r, g, b] => Vec3::new(r, g, b),
        &[grey, ..] => Vec3::splat(grey),
        [] => return None,
    };
    colour.is_finite().then_some(colour)
}

/// Options and file name of a `map_` statement; the name may contain spaces.
fn map(text: &str) -> Map {
    let mut map = Map {
        name: String::new(),
        scale: Vec2::ONE,
        offset: Vec2::ZERO,
        clamp: false,
    };
    let mut rest = text.trim();
    while rest.starts_with('-') {
        let (option, after) = word(rest);
        rest = after;
        let most = match option {
            "-o" | "-s" | "-t" => 3,
            "-mm" => 2,
            _ => 1,
        };
        let mut numbers = Vec::new();
        for i in 0..most {
            let (argument, after) = word(rest);
            let number = argument.parse::<f32>().ok().filter(|n| n.is_finite());
            if most == 3 && number.is_none() && i > 0 {
                break;
            }
            map.clamp |= option == "-clamp" && argument == "on";
            numbers.extend(number);
            rest = after;
        }
        let get = |i: usize, missing: f32| numbers.get(i).copied().unwrap_or(missing);
        match option {
            "-s" => map.scale = Vec2::new(get(0, 1.0), get(1, 1.0)),
            "-o" => map.offset = Vec2::new(get(0, 0.0), get(1, 0.0)),
            _ => {}
        }
    }
    map.name = rest.into();
    map
}

/// First word and what follows it.
fn word(text: &str) -> (&str, &str) {
    let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    (word, rest.trim_start())
}
