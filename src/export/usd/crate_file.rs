//! Crate files (`.usdc`): the binary form of a USD layer.
//!
//! *Layout*, little endian: `PXR-USDC`, the version, the place of the table of contents; then values, and the sections TOKENS, STRINGS,
//! FIELDS, FIELDSETS, PATHS and SPECS, of which the table of contents has name, place and size. A spec is a path with a set of fields; a
//! field is a name with a value; a value is 64 bits, which hold it or the place where it is. Version 0.8.0: sections and integers are
//! compressed, lengths have 64 bits. It is what OpenUSD writes by default; 19.03 and later read it (OpenUSD, `pxr/usd/sdf/crateFile.cpp`).
//!
//! All lengths are known before the first byte is written, so a file is written from its begin to its end, and values that are
//! computed while it is written need no memory before.

use super::compress::{MAX_BLOCK, compress, compress_integers, max_encoded};
use std::{
    collections::HashMap,
    io::{self, Write},
};

/// The bytes before the first value.
const BOOTSTRAP: u64 = 88;

/// The version of the format.
const VERSION: [u8; 3] = [0, 8, 0];

/// Arrays of fewer integers are not compressed.
const MIN_COMPRESSED: usize = 16;

/// Type of a value, as files number it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Type {
    Int = 3,
    Int64 = 5,
    Float = 8,
    Double = 9,
    Token = 11,
    Quatf = 17,
    Vec3d = 23,
    Vec3f = 24,
    TokenVector = 41,
    Specifier = 42,
    Variability = 44,
    TimeSamples = 46,
    DoubleVector = 48,
}

const ARRAY: u64 = 1 << 63;
const INLINED: u64 = 1 << 62;
const COMPRESSED: u64 = 1 << 61;

/// A value of a layer: 64 bits that hold it, or where it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Value(u64);

impl Value {
    fn at(kind: Type, place: u64) -> Self {
        Self((kind as u64) << 48 | place)
    }

    fn inlined(kind: Type, bits: u32) -> Self {
        Self(INLINED | (kind as u64) << 48 | u64::from(bits))
    }
}

/// Values of a file before the structure.
enum Payload {
    Bytes(Vec<u8>),
    /// So many bytes, which are made while the file is written.
    Deferred(u64),
}

/// An attribute of a prim.
#[derive(Clone, Debug)]
pub(crate) struct Attribute {
    /// Name, with its namespaces.
    pub(crate) name: String,
    /// Type, as text files write it.
    pub(crate) type_name: &'static str,
    /// Whether it cannot vary in time.
    pub(crate) is_uniform: bool,
    /// How it is interpolated over a mesh, if that is no matter of its schema.
    pub(crate) interpolation: Option<&'static str>,
    /// The value without a time.
    pub(crate) default: Option<Value>,
    /// Values at times.
    pub(crate) samples: Option<Value>,
}

/// A prim with its attributes, without children.
#[derive(Clone, Debug)]
pub(crate) struct Prim {
    /// Name: a USD identifier.
    pub(crate) name: String,
    /// Schema.
    pub(crate) type_name: &'static str,
    /// Attributes, each of another name.
    pub(crate) attributes: Vec<Attribute>,
    /// Children, each of another name.
    pub(crate) children: Vec<Self>,
}

/// A crate file that is being made.
#[derive(Default)]
pub(crate) struct CrateFile {
    payloads: Vec<Payload>,
    /// Bytes of all payloads.
    length: u64,
    tokens: Vec<String>,
    token_places: HashMap<String, u32>,
    fields: Vec<(u32, Value)>,
    field_places: HashMap<(u32, Value), u32>,
    field_sets: Vec<i32>,
    /// Path, first place in `field_sets` and type of each spec.
    specs: Vec<[i32; 3]>,
    /// Path, element and jump of each node of the tree of paths.
    paths: Vec<[i32; 3]>,
}

/// The end of a set of fields.
const END_OF_SET: i32 = -1;

/// Types of specs, as files number them.
const ATTRIBUTE: i32 = 1;
const PRIM: i32 = 6;
const PSEUDO_ROOT: i32 = 7;

impl CrateFile {
    /// A file without values.
    pub(crate) fn new() -> Self {
        let mut file = Self::default();
        // Paths of properties have the negative number of their name: it must not be 0.
        file.token_place("");
        file
    }

    /// Adds bytes at a place that is a multiple of 8, and returns that place.
    fn add(&mut self, payload: Payload) -> u64 {
        let place = BOOTSTRAP + self.length;
        let length = match &payload {
            Payload::Bytes(bytes) => bytes.len() as u64,
            Payload::Deferred(length) => *length,
        };
        self.payloads.push(payload);
        let padding = length.next_multiple_of(8) - length;
        if padding > 0 {
            self.payloads.push(Payload::Bytes(vec![0; padding as usize]));
        }
        self.length += length + padding;
        place
    }

    fn token_place(&mut self, token: &str) -> u32 {
        if let Some(&place) = self.token_places.get(token) {
            return place;
        }
        let place = self.tokens.len() as u32;
        self.tokens.push(token.to_owned());
        self.token_places.insert(token.to_owned(), place);
        place
    }

    /// A token.
    pub(crate) fn token(&mut self, token: &str) -> Value {
        Value::inlined(Type::Token, self.token_place(token))
    }

    /// A number.
    pub(crate) fn double(&mut self, number: f64) -> Value {
        Value::at(Type::Double, self.add(Payload::Bytes(number.to_le_bytes().to_vec())))
    }

    /// An array of tokens.
    pub(crate) fn tokens(&mut self, tokens: &[&str]) -> Value {
        let value = self.token_list(tokens, Type::Token);
        Value(value.0 | ARRAY)
    }

    fn token_list(&mut self, tokens: &[&str], kind: Type) -> Value {
        let mut bytes = (tokens.len() as u64).to_le_bytes().to_vec();
        for token in tokens {
            bytes.extend(self.token_place(token).to_le_bytes());
        }
        Value::at(kind, self.add(Payload::Bytes(bytes)))
    }

    /// An array whose elements have these bytes.
    fn array(&mut self, kind: Type, count: usize, elements: impl Iterator<Item = u8>) -> Value {
        if count == 0 {
            return Value(ARRAY | (kind as u64) << 48);
        }
        let mut bytes = (count as u64).to_le_bytes().to_vec();
        bytes.extend(elements);
        Value(ARRAY | Value::at(kind, self.add(Payload::Bytes(bytes))).0)
    }

    /// An array of numbers.
    pub(crate) fn floats(&mut self, values: &[f32]) -> Value {
        self.array(Type::Float, values.len(), values.iter().flat_map(|value| value.to_le_bytes()))
    }

    /// An array of vectors.
    pub(crate) fn vectors(&mut self, values: &[[f32; 3]]) -> Value {
        let bytes = values.iter().flatten().flat_map(|value| value.to_le_bytes());
        self.array(Type::Vec3f, values.len(), bytes)
    }

    /// An array of so many vectors, which [`CrateFile::write`] requests when it is written.
    pub(crate) fn deferred_vectors(&mut self, count: usize) -> Value {
        if count == 0 {
            return Value(ARRAY | (Type::Vec3f as u64) << 48);
        }
        let place = self.add_unpadded((count as u64).to_le_bytes().to_vec());
        self.add(Payload::Deferred(12 * count as u64));
        Value(ARRAY | Value::at(Type::Vec3f, place).0)
    }

    /// Adds bytes whose number is a multiple of 8.
    fn add_unpadded(&mut self, bytes: Vec<u8>) -> u64 {
        self.add(Payload::Bytes(bytes))
    }

    /// An array of integers; `None` if there are more than a block holds.
    pub(crate) fn integers(&mut self, values: impl ExactSizeIterator<Item = i32> + Clone) -> Option<Value> {
        let count = values.len();
        if count < MIN_COMPRESSED {
            return Some(self.array(Type::Int, count, values.flat_map(i32::to_le_bytes)));
        }
        if max_encoded(count) > MAX_BLOCK {
            return None;
        }
        let compressed = compress_integers(values);
        let mut bytes = (count as u64).to_le_bytes().to_vec();
        bytes.extend((compressed.len() as u64).to_le_bytes());
        bytes.extend(compressed);
        Some(Value(ARRAY | COMPRESSED | Value::at(Type::Int, self.add(Payload::Bytes(bytes))).0))
    }

    /// An array of integers of 64 bits.
    pub(crate) fn long_integers(&mut self, values: impl ExactSizeIterator<Item = i64>) -> Value {
        self.array(Type::Int64, values.len(), values.flat_map(i64::to_le_bytes))
    }

    /// A vector in double precision.
    pub(crate) fn vector(&mut self, value: [f64; 3]) -> Value {
        let bytes = value.into_iter().flat_map(f64::to_le_bytes).collect();
        Value::at(Type::Vec3d, self.add(Payload::Bytes(bytes)))
    }

    /// A vector in single precision.
    pub(crate) fn single_vector(&mut self, value: [f32; 3]) -> Value {
        let bytes = value.into_iter().flat_map(f32::to_le_bytes).collect();
        Value::at(Type::Vec3f, self.add(Payload::Bytes(bytes)))
    }

    /// A quaternion w, x, y, z.
    pub(crate) fn quaternion(&mut self, [w, x, y, z]: [f32; 4]) -> Value {
        let bytes = [x, y, z, w].into_iter().flat_map(f32::to_le_bytes).collect();
        Value::at(Type::Quatf, self.add(Payload::Bytes(bytes)))
    }

    /// Times, for [`CrateFile::samples`].
    pub(crate) fn times(&mut self, times: &[f64]) -> Value {
        let mut bytes = (times.len() as u64).to_le_bytes().to_vec();
        bytes.extend(times.iter().flat_map(|time| time.to_le_bytes()));
        Value::at(Type::DoubleVector, self.add(Payload::Bytes(bytes)))
    }

    /// A value at each of the [`times`](CrateFile::times).
    pub(crate) fn samples(&mut self, times: Value, values: &[Value]) -> Value {
        // Distances to what follows, behind the times and the values, which are elsewhere.
        let words =
            [8, times.0, 8, values.len() as u64].into_iter().chain(values.iter().map(|value| value.0));
        let bytes = words.flat_map(u64::to_le_bytes).collect();
        Value::at(Type::TimeSamples, self.add(Payload::Bytes(bytes)))
    }

    /// Adds a set of fields, and returns its place.
    fn field_set(&mut self, fields: &[(&str, Value)]) -> i32 {
        let place = self.field_sets.len() as i32;
        for &(name, value) in fields {
            let field = (self.token_place(name), value);
            let next = self.fields.len() as u32;
            let known = *self.field_places.entry(field).or_insert(next);
            if known == next {
                self.fields.push(field);
            }
            self.field_sets.push(known as i32);
        }
        self.field_sets.push(END_OF_SET);
        place
    }

    /// Adds the spec of a path, and returns the path's number.
    fn spec(&mut self, fields: &[(&str, Value)], kind: i32) -> i32 {
        let path = self.specs.len() as i32;
        let set = self.field_set(fields);
        self.specs.push([path, set, kind]);
        path
    }

    /// Adds a node of the tree of paths with what `add_children` adds below it.
    fn node(&mut self, path: i32, element: i32, has_sibling: bool, add_children: impl FnOnce(&mut Self)) {
        let place = self.paths.len();
        self.paths.push([path, element, 0]);
        add_children(self);
        let nodes = (self.paths.len() - place) as i32;
        self.paths[place][2] = match (nodes > 1, has_sibling) {
            (false, true) => 0,
            (true, false) => -1,
            (false, false) => -2,
            (true, true) => nodes,
        };
    }

    fn prim(&mut self, prim: &Prim, has_sibling: bool) {
        // 0: defined.
        let mut fields = vec![("specifier", Value::inlined(Type::Specifier, 0))];
        fields.push(("typeName", self.token(prim.type_name)));
        let names: Vec<&str> = prim.attributes.iter().map(|attribute| attribute.name.as_str()).collect();
        if !names.is_empty() {
            fields.push(("properties", self.token_list(&names, Type::TokenVector)));
        }
        let children: Vec<&str> = prim.children.iter().map(|child| child.name.as_str()).collect();
        if !children.is_empty() {
            fields.push(("primChildren", self.token_list(&children, Type::TokenVector)));
        }
        let (path, element) = (self.spec(&fields, PRIM), self.token_place(&prim.name) as i32);
        self.node(path, element, has_sibling, |file| {
            for (place, attribute) in prim.attributes.iter().enumerate() {
                let is_last = place + 1 == prim.attributes.len() && prim.children.is_empty();
                file.attribute(attribute, !is_last);
            }
            for (place, child) in prim.children.iter().enumerate() {
                file.prim(child, place + 1 < prim.children.len());
            }
        });
    }

    fn attribute(&mut self, attribute: &Attribute, has_sibling: bool) {
        let mut fields = vec![("typeName", self.token(attribute.type_name))];
        if attribute.is_uniform {
            fields.push(("variability", Value::inlined(Type::Variability, 1)));
        }
        if let Some(interpolation) = attribute.interpolation {
            fields.push(("interpolation", self.token(interpolation)));
        }
        fields.extend(attribute.default.map(|value| ("default", value)));
        fields.extend(attribute.samples.map(|value| ("timeSamples", value)));
        let path = self.spec(&fields, ATTRIBUTE);
        let element = -(self.token_place(&attribute.name) as i32);
        self.node(path, element, has_sibling, |_| {});
    }

    /// Writes the layer that has these fields and one prim. `fill` writes the elements of the deferred arrays one after the other, in
    /// the order in which they were added; it gets the number of each.
    ///
    /// # Errors
    /// Those of the writer and of `fill`; if that writes another number of bytes than the array has.
    pub(crate) fn write(
        mut self,
        layer: &[(&str, Value)],
        prim: &Prim,
        out: &mut dyn Write,
        mut fill: impl FnMut(usize, &mut dyn Write) -> io::Result<()>,
    ) -> io::Result<()> {
        let mut fields = layer.to_vec();
        fields.push(("primChildren", self.token_list(&[&prim.name], Type::TokenVector)));
        let root = self.spec(&fields, PSEUDO_ROOT);
        self.node(root, 0, false, |file| file.prim(prim, false));
        let sections = self.sections();
        let mut place = BOOTSTRAP + self.length;
        let mut contents = (sections.len() as u64).to_le_bytes().to_vec();
        for (name, bytes) in &sections {
            let mut padded = [0; 16];
            padded[..name.len()].copy_from_slice(name.as_bytes());
            contents.extend(padded);
            contents.extend(place.to_le_bytes());
            contents.extend((bytes.len() as u64).to_le_bytes());
            place += bytes.len() as u64;
        }
        let mut head = b"PXR-USDC".to_vec();
        head.extend(VERSION);
        head.resize(16, 0);
        head.extend(place.to_le_bytes());
        head.resize(BOOTSTRAP as usize, 0);
        out.write_all(&head)?;
        let mut deferred = 0;
        for payload in self.payloads {
            match payload {
                Payload::Bytes(bytes) => out.write_all(&bytes)?,
                Payload::Deferred(length) => {
                    let mut counted = Counted { out, left: length };
                    fill(deferred, &mut counted)?;
                    if counted.left > 0 {
                        return Err(io::Error::other("an array has fewer elements than were announced"));
                    }
                    deferred += 1;
                }
            }
        }
        sections.iter().try_for_each(|(_, bytes)| out.write_all(bytes))?;
        out.write_all(&contents)
    }

    /// The sections with the structure.
    fn sections(&self) -> [(&'static str, Vec<u8>); 6] {
        let count = |length: usize| (length as u64).to_le_bytes().to_vec();
        let sized = |bytes: Vec<u8>| [count(bytes.len()), bytes].concat();
        let integers = |values: &mut dyn Iterator<Item = i32>| {
            let values: Vec<i32> = values.collect();
            sized(compress_integers(values.into_iter()))
        };
        let text: Vec<u8> = self.tokens.iter().flat_map(|token| token.bytes().chain([0])).collect();
        let tokens = [count(self.tokens.len()), count(text.len()), sized(compress(&text))].concat();
        // No value is a text.
        let strings = count(0);
        let values: Vec<u8> = self.fields.iter().flat_map(|(_, value)| value.0.to_le_bytes()).collect();
        let names = integers(&mut self.fields.iter().map(|&(name, _)| name as i32));
        let fields = [count(self.fields.len()), names, sized(compress(&values))].concat();
        let sets = [count(self.field_sets.len()), integers(&mut self.field_sets.iter().copied())].concat();
        let columns = |rows: &[[i32; 3]]| -> Vec<u8> {
            (0..3).flat_map(|column| integers(&mut rows.iter().map(|row| row[column]))).collect()
        };
        let paths = [count(self.paths.len()), count(self.paths.len()), columns(&self.paths)].concat();
        let specs = [count(self.specs.len()), columns(&self.specs)].concat();
        [
            ("TOKENS", tokens),
            ("STRINGS", strings),
            ("FIELDS", fields),
            ("FIELDSETS", sets),
            ("PATHS", paths),
            ("SPECS", specs),
        ]
    }
}

/// A writer of an announced number of bytes.
struct Counted<'a> {
    out: &'a mut dyn Write,
    left: u64,
}

impl Write for Counted<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if bytes.len() as u64 > self.left {
            return Err(io::Error::other("an array has more elements than were announced"));
        }
        self.out.write_all(bytes)?;
        self.left -= bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
