//! Typed reading of glTF accessors. Every claim of the file is held against the bytes that are
//! there before anything is allocated.

use crate::error::{Error, Result};
use ::gltf::accessor::sparse::IndexType;
use ::gltf::accessor::{Accessor, DataType, Dimensions};
use ::gltf::buffer::View;
use std::path::Path;

/// The buffers of one file.
pub(super) struct Buffers<'a> {
    /// The scene file, for messages.
    pub file: &'a Path,
    /// Bytes of each buffer; empty where the file has none.
    pub data: Vec<Vec<u8>>,
}

/// Elements of equal size in a buffer view, all of them within it.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
}

impl<'a> Elements<'a> {
    fn iter(&self) -> impl Iterator<Item = &'a [u8]> {
        let size = self.size;
        // The last chunk may be shorter than the stride, never than the element.
        self.bytes
            .chunks(self.stride)
            .map(move |chunk| &chunk[..size])
    }
}

impl Buffers<'_> {
    /// The bytes of a whole buffer view.
    pub fn view(&self, view: &View<'_>) -> std::result::Result<&[u8], String> {
        let buffer = self
            .data
            .get(view.buffer().index())
            .map_or(&[][..], Vec::as_slice);
        view.offset()
            .checked_add(view.length())
            .and_then(|end| buffer.get(view.offset()..end))
            .ok_or_else(|| {
                format!(
                    "buffer view {} needs {} bytes from byte {}, but buffer {} has {}",
                    view.index(),
                    view.length(),
                    view.offset(),
                    view.buffer().index(),
                    buffer.len()
                )
            })
    }

    fn elements(
        &self,
        view: &View<'_>,
        offset: usize,
        size: usize,
        count: usize,
    ) -> std::result::Result<Elements<'_>, String> {
        let bytes = self.view(view)?;
        let stride = view.stride().unwrap_or(size);
        if stride < size {
            return Err(format!(
                "a stride of {stride} bytes is less than an element of {size}"
            ));
        }
        let end = match count.checked_sub(1) {
            Some(last) => last
                .checked_mul(stride)
                .and_then(|b| b.checked_add(size))
                .and_then(|b| b.checked_add(offset)),
            None => Some(offset),
        };
        match end.and_then(|end| bytes.get(offset..end)) {
            Some(bytes) => Ok(Elements {
                bytes,
                stride,
                size,
            }),
            None => Err(format!(
                "{count} elements of {size} bytes from byte {offset} do not fit into {} bytes",
                bytes.len()
            )),
        }
    }

    /// Vectors of `N` components; integers are normalised where the file says so.
    ///
    /// # Errors
    /// [`Error::Input`] naming the accessor: wrong type, or more elements than the file holds.
    pub fn vectors<const N: usize>(&self, accessor: &Accessor<'_>) -> Result<Vec<[f32; N]>> {
        let wanted = if N == 2 {
            Dimensions::Vec2
        } else {
            Dimensions::Vec3
        };
        if accessor.dimensions() != wanted {
            let problem = format!("is {:?}, not {wanted:?}", accessor.dimensions());
            return Err(self.error(accessor, problem));
        }
        let decode = |bytes: &[u8]| {
            let size = bytes.len() / N;
            std::array::from_fn(|i| {
                number(
                    &bytes[i * size..(i + 1) * size],
                    accessor.data_type(),
                    accessor.normalized(),
                )
            })
        };
        self.read(accessor, decode, [0.0; N])
    }

    /// Vertex numbers.
    ///
    /// # Errors
    /// [`Error::Input`] naming the accessor: wrong type, or more elements than the file holds.
    pub fn indices(&self, accessor: &Accessor<'_>) -> Result<Vec<u32>> {
        let unsigned = matches!(
            accessor.data_type(),
            DataType::U8 | DataType::U16 | DataType::U32
        );
        if !unsigned || accessor.dimensions() != Dimensions::Scalar {
            return Err(self.error(accessor, "is not made of unsigned integers".into()));
        }
        self.read(accessor, integer, 0)
    }

    fn read<T: Copy>(
        &self,
        accessor: &Accessor<'_>,
        decode: impl Fn(&[u8]) -> T,
        zero: T,
    ) -> Result<Vec<T>> {
        let (size, count) = (accessor.size(), accessor.count());
        let fail = |problem| self.error(accessor, problem);
        let mut values = match accessor.view() {
            Some(view) => {
                let elements = self
                    .elements(&view, accessor.offset(), size, count)
                    .map_err(fail)?;
                elements.iter().map(&decode).collect()
            }
            // Zeros, to be overwritten: the claim must bear some relation to the file's size.
            None if accessor.sparse().is_some()
                && count <= self.data.iter().map(Vec::len).sum::<usize>() =>
            {
                vec![zero; count]
            }
            None => {
                return Err(fail(format!(
                    "claims {count} elements and has no buffer view"
                )));
            }
        };
        if let Some(sparse) = accessor.sparse() {
            let (indices, replaced) = (sparse.indices(), sparse.count());
            let index_size = match indices.index_type() {
                IndexType::U8 => 1,
                IndexType::U16 => 2,
                IndexType::U32 => 4,
            };
            let at = self
                .elements(&indices.view(), indices.offset(), index_size, replaced)
                .map_err(fail)?;
            let with = self
                .elements(
                    &sparse.values().view(),
                    sparse.values().offset(),
                    size,
                    replaced,
                )
                .map_err(fail)?;
            for (index, value) in at.iter().zip(with.iter()) {
                let index = integer(index) as usize;
                *values.get_mut(index).ok_or_else(|| {
                    fail(format!("replaces element {index} of {count} (sparse)"))
                })? = decode(value);
            }
        }
        Ok(values)
    }

    fn error(&self, accessor: &Accessor<'_>, problem: String) -> Error {
        let element = format!("accessor {}", accessor.index());
        Error::input(
            self.file,
            element,
            problem,
            "export the file again; it may be cut short",
        )
    }
}

fn integer(bytes: &[u8]) -> u32 {
    bytes
        .iter()
        .rev()
        .fold(0, |value, &b| value << 8 | u32::from(b))
}

/// One component; normalised integers as glTF 2.0, section 3.6.2.2 says.
fn number(bytes: &[u8], kind: DataType, normalized: bool) -> f32 {
    let bits = integer(bytes);
    let (value, greatest) = match kind {
        DataType::F32 => return f32::from_bits(bits),
        DataType::U32 => return bits as f32,
        DataType::I8 => (f32::from(bits as u8 as i8), 127.0),
        DataType::U8 => (bits as f32, 255.0),
        DataType::I16 => (f32::from(bits as u16 as i16), 32767.0),
        DataType::U16 => (bits as f32, 65535.0),
    };
    if normalized {
        (value / greatest).max(-1.0)
    } else {
        value
    }
}
