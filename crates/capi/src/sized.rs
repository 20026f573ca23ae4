//! Reads and writes memory of the C caller: structs that grow from version to version, strings, arrays, and variables
//! that receive results. A caller that was compiled with an older or newer header has smaller or larger structs; the
//! first field of a struct holds its size.

use std::ffi::{CStr, c_char};

use super::status::{Failure, Outcome, palpate_status};

/// A struct of the C interface whose first field is its size in bytes in the header that the caller was compiled with.
///
/// # Safety
/// The struct is `repr(C)`, its first field is a `u32` with the size, and any bytes are a valid value of it.
pub(super) unsafe trait Sized32: Copy {
    /// Name of the struct in the header.
    const NAME: &str;
    /// Size of the struct's first version, bytes.
    const LEAST: usize;
    /// All fields in order, as [`fields!`] lists them.
    const FIELDS: &'static [Field];
    /// Returns the struct with default values. They remain in the fields that an older caller does not know.
    fn unset() -> Self;
}

/// Where a field begins and ends in its struct, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Field {
    pub start: usize,
    pub end: usize,
}

impl Field {
    /// A field at offset `start`; the accessor function gives its type, and so its size.
    pub const fn at<S, F>(start: usize, _: fn(&S) -> &F) -> Field {
        Field { start, end: start + size_of::<F>() }
    }
}

/// Makes the [`Sized32::FIELDS`] of a struct. It does not compile if the list lacks a field of the struct, or names a
/// field that the struct lacks.
macro_rules! fields {
    ($name:ident { $($field:ident),+ $(,)? }) => {{
        const _: fn(&$name) = |whole| {
            let $name { $($field: _),+ } = whole;
        };
        &[$($crate::sized::Field::at(std::mem::offset_of!($name, $field), |whole: &$name| &whole.$field)),+]
    }};
}
pub(super) use fields;

/// Returns whether a caller's struct may have this size, that is, whether the size cuts no field in two. Some version
/// of the header must give the struct this size: it is the end of a field; or the end of the padding after a field,
/// which sizeof includes in a version that ended with this field; or the present size of the struct, or more.
fn ends_whole<T: Sized32>(size: usize) -> bool {
    let starts = T::FIELDS.iter().skip(1).map(|field| field.start).chain([size_of::<T>()]);
    let padded =
        |field: &Field, next: usize| Some(field.end.next_multiple_of(align_of::<T>())).filter(|end| *end <= next);
    let is_end =
        T::FIELDS.iter().zip(starts).any(|(field, next)| size == field.end || padded(field, next) == Some(size));
    is_end || size >= size_of::<T>()
}

/// Reads a caller's struct of any version; null: all defaults.
///
/// # Safety
/// `from` is null, or as many bytes can be read there as its first field states.
pub(super) unsafe fn read<T: Sized32>(from: *const T) -> Outcome<T> {
    let mut value = T::unset();
    if from.is_null() {
        return Ok(value);
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let size = unsafe { size_of_struct(from)? };
    let known = size.min(size_of::<T>());
    // SAFETY: the caller keeps the conditions under `# Safety`; any bytes are a `T`, and `value` has room for `known`.
    unsafe { std::ptr::copy_nonoverlapping(from.cast::<u8>(), (&raw mut value).cast::<u8>(), known) };
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let beyond = unsafe { std::slice::from_raw_parts(from.cast::<u8>().add(known), size - known) };
    if beyond.iter().any(|byte| *byte != 0) {
        let problem =
            format!("{} sets fields that this version of the library does not know; use a newer library", T::NAME);
        return Err(Failure::new(palpate_status::Argument, problem));
    }
    Ok(value)
}

/// Writes as many bytes of a struct as the caller's version of it has; the caller's size field stays as it is.
///
/// # Safety
/// As many bytes can be written at `to` as its first field states.
pub(super) unsafe fn write<T: Sized32>(to: *mut T, value: &T) -> Outcome {
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let size = unsafe { size_of_struct(to.cast_const())? };
    let known = size.min(size_of::<T>()) - size_of::<u32>();
    // SAFETY: the caller keeps the conditions under `# Safety`; `value` is at least as large, and its first four bytes,
    // which are skipped, are its size.
    unsafe {
        let from = (&raw const *value).cast::<u8>().add(size_of::<u32>());
        std::ptr::copy_nonoverlapping(from, to.cast::<u8>().add(size_of::<u32>()), known);
    }
    Ok(())
}

/// Writes a result to the caller's struct as [`write`] does; null is refused.
///
/// # Safety
/// `to` is null, or as many bytes can be written there as its first field states.
pub(super) unsafe fn tell<T: Sized32>(to: *mut T, value: &T, name: &str) -> Outcome {
    if to.is_null() {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null; pass the address for the answer")));
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    unsafe { write(to, value) }
}

/// Reads and checks the size in the first field of a caller's struct, bytes.
///
/// # Safety
/// A `u32` can be read at `of`, if it is aligned.
unsafe fn size_of_struct<T: Sized32>(of: *const T) -> Outcome<usize> {
    if !of.is_aligned() {
        return Err(Failure::new(palpate_status::Argument, format!("{} is not aligned", T::NAME)));
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let size = unsafe { of.cast::<u32>().read() } as usize;
    if size < T::LEAST || size > 1 << 16 {
        let problem = format!("{0}.size is {size}; set it to sizeof({0})", T::NAME);
        return Err(Failure::new(palpate_status::Argument, problem));
    }
    if !ends_whole::<T>(size) {
        let problem = format!("{0}.size is {size}, which cuts a field in two; set it to sizeof({0})", T::NAME);
        return Err(Failure::new(palpate_status::Argument, problem));
    }
    Ok(size)
}

/// Reads a string of the caller; null is refused.
///
/// # Safety
/// `text` is null, or is terminated by a zero and lives as long as the result is used.
pub(super) unsafe fn string<'a>(text: *const c_char, name: &str) -> Outcome<&'a str> {
    if text.is_null() {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null; give a string")));
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|_| Failure::new(palpate_status::Argument, format!("{name} is not UTF-8")))
}

/// Borrows an array of the caller, which may be null if `count` is 0.
///
/// # Safety
/// `from` is null or leads to `count` elements, which live as long as the result is used; any bytes are a value of `T`.
pub(super) unsafe fn array<'a, T>(from: *const T, count: usize, name: &str) -> Outcome<&'a [T]> {
    if count == 0 {
        return Ok(&[]);
    }
    if from.is_null() {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null, but its count is {count}")));
    }
    let problem = match count.checked_mul(size_of::<T>()) {
        Some(bytes) if bytes <= isize::MAX as usize && from.is_aligned() => {
            // SAFETY: the caller keeps the conditions under `# Safety`; null, alignment and length were checked above.
            return Ok(unsafe { std::slice::from_raw_parts(from, count) });
        }
        Some(bytes) if bytes <= isize::MAX as usize => format!("{name} is not aligned"),
        _ => format!("{name} has {count} elements, more than fit into memory"),
    };
    Err(Failure::new(palpate_status::Argument, problem))
}

/// Borrows an array of `count` rows of N numbers, stored one after another.
///
/// # Safety
/// The conditions of [`array`], with N numbers per row.
pub(super) unsafe fn rows<'a, T, const N: usize>(from: *const T, count: usize, name: &str) -> Outcome<&'a [[T; N]]> {
    // SAFETY: the caller keeps the conditions under `# Safety`; `[T; N]` is aligned as `T` is.
    unsafe { array(from.cast::<[T; N]>(), count, name) }
}

/// Copies an array of structs whose size depends on the caller's version; all must have the size that the first one
/// states.
///
/// # Safety
/// `from` is null or leads to `count` structs of that size.
pub(super) unsafe fn structs<T: Sized32>(from: *const T, count: usize, name: &str) -> Outcome<Vec<T>> {
    if count == 0 {
        return Ok(Vec::new());
    }
    // SAFETY: the caller keeps the conditions under `# Safety`, so the size of the first struct can be read.
    let size = unsafe {
        array(from.cast::<u32>(), 1, name)?;
        size_of_struct(from)?
    };
    if count.checked_mul(size).is_none_or(|bytes| bytes > isize::MAX as usize) {
        let problem = format!("{name} has {count} elements, more than fit into memory");
        return Err(Failure::new(palpate_status::Argument, problem));
    }
    let one = |k: usize| {
        // SAFETY: the caller keeps the conditions under `# Safety`.
        let at = unsafe { from.byte_add(k * size) };
        // SAFETY: the caller keeps the conditions under `# Safety`.
        match unsafe { size_of_struct(at)? } == size {
            // SAFETY: the caller keeps the conditions under `# Safety`.
            true => unsafe { read(at) },
            false => {
                let problem = format!("{name}[{k}].size is not that of the first; set all to sizeof({})", T::NAME);
                Err(Failure::new(palpate_status::Argument, problem))
            }
        }
    };
    (0..count).map(one).collect()
}

/// Borrows the caller's variable that receives a result; null is refused.
///
/// # Safety
/// `to` is null, or can be written for as long as the result is used.
pub(super) unsafe fn answer<'a, T>(to: *mut T, name: &str) -> Outcome<&'a mut T> {
    if !to.is_aligned() {
        return Err(Failure::new(palpate_status::Argument, format!("{name} is not aligned")));
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let to = unsafe { to.as_mut() };
    to.ok_or_else(|| Failure::new(palpate_status::Null, format!("{name} is null; pass the address for the answer")))
}

/// Borrows a value that the caller passes by a pointer; `None` if the pointer is null.
///
/// # Safety
/// `from` is null, or can be read for as long as the result is used.
pub(super) unsafe fn given<'a, T>(from: *const T, name: &str) -> Outcome<Option<&'a T>> {
    match from.is_aligned() {
        // SAFETY: the caller keeps the conditions under `# Safety`.
        true => Ok(unsafe { from.as_ref() }),
        false => Err(Failure::new(palpate_status::Argument, format!("{name} is not aligned"))),
    }
}

/// Copies all elements of `from` into the caller's array. Errors: the array is too small, and nothing was copied.
///
/// # Safety
/// `to` is null or has room for `capacity` elements.
pub(super) unsafe fn copy<T: Copy>(from: &[T], to: *mut T, capacity: usize, name: &str) -> Outcome {
    if to.is_null() && capacity > 0 {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null, but its capacity is {capacity}")));
    }
    if !to.is_aligned() {
        return Err(Failure::new(palpate_status::Argument, format!("{name} is not aligned")));
    }
    if capacity < from.len() {
        let problem = format!("{name} has room for {capacity} of {} elements", from.len());
        return Err(Failure::new(palpate_status::TooSmall, problem));
    }
    if !from.is_empty() {
        // SAFETY: the caller keeps the conditions under `# Safety`; `from` is the library's, so nothing overlaps.
        unsafe { std::ptr::copy_nonoverlapping(from.as_ptr(), to, from.len()) };
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::change::{palpate_contact_law, palpate_coupling, palpate_material};
    use super::super::context::palpate_context_options;
    use super::super::describe::{palpate_body, palpate_core, palpate_settings, palpate_tool};
    use super::super::haptic_device::palpate_haptic_device;
    use super::super::host::palpate_vulkan;
    use super::super::loop_options::palpate_loop_options;
    use super::super::loop_state::palpate_loop_state;
    use super::super::shown::palpate_skins;
    use super::super::simulation::palpate_wrench;
    use super::*;

    /// A struct whose first version ended with `old`, so that an older program does not know `new`.
    #[repr(C)]
    #[derive(Debug, Clone, Copy, PartialEq)]
    struct Grown {
        size: u32,
        old: u32,
        new: u32,
    }

    // SAFETY: it is `repr(C)`, its first field is the size, and all fields are numbers: any bytes are a value.
    unsafe impl Sized32 for Grown {
        const NAME: &str = "grown";
        const LEAST: usize = 8;
        const FIELDS: &'static [Field] = fields!(Grown { size, old, new });

        fn unset() -> Self {
            Grown { size: 12, old: 1, new: 2 }
        }
    }

    #[test]
    fn what_an_older_program_does_not_know_is_neither_read_nor_written() {
        let mut given = Grown { size: 8, old: 5, new: 77 };
        // SAFETY (all in this test): the struct has at least as many bytes as its size field states.
        assert_eq!(unsafe { read(&given) }.unwrap(), Grown { size: 8, old: 5, new: 2 });
        unsafe { write(&mut given, &Grown { size: 12, old: 6, new: 9 }) }.unwrap();
        assert_eq!(given, Grown { size: 8, old: 6, new: 77 });
        given.size = 7;
        assert!(unsafe { read(&given) }.unwrap_err().message.contains("grown.size is 7"));
    }

    /// A struct with padding: `large` begins after padding, and `bytes` begins where the version that ended with `half`
    /// had padding.
    #[repr(C, align(8))]
    #[derive(Debug, Clone, Copy, PartialEq)]
    struct Padded {
        size: u32,
        old: u32,
        small: u8,
        large: u64,
        half: u32,
        bytes: [u8; 8],
    }

    // SAFETY: it is `repr(C)`, its first field is the size, and all fields are numbers: any bytes are a value.
    unsafe impl Sized32 for Padded {
        const NAME: &str = "padded";
        const LEAST: usize = 8;
        const FIELDS: &'static [Field] = fields!(Padded { size, old, small, large, half, bytes });

        fn unset() -> Self {
            Padded { size: 40, old: 0, small: 0, large: 0, half: 0, bytes: [0; 8] }
        }
    }

    #[test]
    fn sizes_of_all_versions_are_taken_and_no_others() {
        // Counted by hand, in bytes: `old` ends at 8; `small` at 9, padded to 16; `large` at 24; `half` at 28, where
        // `bytes` begins; `bytes` at 36, padded to 40.
        let taken: Vec<usize> = (8..43).filter(|size| ends_whole::<Padded>(*size)).collect();
        assert_eq!(taken, [8, 9, 16, 24, 28, 36, 40, 41, 42]);
        let taken: Vec<usize> = (8..14).filter(|size| ends_whole::<Grown>(*size)).collect();
        assert_eq!(taken, [8, 12, 13]);
        let taken: Vec<usize> = (16..=50).filter(|size| ends_whole::<palpate_context_options>(*size)).collect();
        if size_of::<*const u8>() == 8 {
            assert_eq!(taken, [16, 24, 32, 40, 44, 48, 49, 50]);
        }
    }

    /// Tries to read and write a struct with every stated size from 0 to beyond its true size, checks which sizes are
    /// accepted, and returns the name of the struct.
    fn try_every_size<T: Sized32>() -> &'static str {
        let (name, whole) = (T::NAME, size_of::<T>());
        let fields = T::FIELDS;
        // `FIELDS` covers the struct: it begins with the size, leaves no gap but padding, and ends where the struct
        // does.
        assert_eq!(fields[0], Field { start: 0, end: 4 }, "first field of {name}");
        for pair in fields.windows(2) {
            assert!(
                pair[0].end <= pair[1].start && pair[1].start - pair[0].end < align_of::<T>(),
                "gap between fields of {name}: {pair:?}"
            );
        }
        assert_eq!(
            fields[fields.len() - 1].end.next_multiple_of(align_of::<T>()),
            whole,
            "end of the last field of {name}"
        );
        let mut taken = 0;
        for size in 0..=whole + 16 {
            // Memory for the struct, aligned for any field, and zero except for the size.
            let mut place = vec![0u64; (whole + 16).div_ceil(8)];
            let pointer = place.as_mut_ptr().cast::<T>();
            // SAFETY (all in this loop): `place` has as many bytes as the size states; zero is a value of every field.
            unsafe { pointer.cast::<u32>().write(size as u32) };
            let is_cut = fields.iter().any(|field| field.start < size && size < field.end);
            match unsafe { read(pointer.cast_const()) } {
                Ok(_) => {
                    assert!(size >= T::LEAST && !is_cut, "{name} was accepted with a size of {size} bytes");
                    unsafe { write(pointer, &T::unset()) }.unwrap();
                    taken += 1;
                }
                Err(failure) => {
                    let message = failure.message;
                    assert!(message.starts_with(&format!("{name}.size is {size}")), "unexpected error: {message}");
                    assert!(message.ends_with(&format!("set it to sizeof({name})")) && !message.contains('\n'));
                    let is_end = fields.iter().any(|field| field.end == size);
                    assert!(
                        size < T::LEAST || !is_end && size < whole,
                        "{name} was refused with a size of {size} bytes: {message}"
                    );
                    assert!(
                        unsafe { write(pointer, &T::unset()) }.is_err(),
                        "{name} was written with a wrong size of {size} bytes"
                    );
                }
            }
        }
        assert!(taken >= 17, "number of accepted sizes of {name}: {taken}");
        name
    }

    #[test]
    fn no_struct_of_the_interface_is_cut_within_a_field() {
        let tried = [
            try_every_size::<palpate_context_options>(),
            try_every_size::<palpate_vulkan>(),
            try_every_size::<palpate_wrench>(),
            try_every_size::<palpate_material>(),
            try_every_size::<palpate_contact_law>(),
            try_every_size::<palpate_coupling>(),
            try_every_size::<palpate_settings>(),
            try_every_size::<palpate_core>(),
            try_every_size::<palpate_body>(),
            try_every_size::<palpate_tool>(),
            try_every_size::<palpate_skins>(),
            try_every_size::<palpate_haptic_device>(),
            try_every_size::<palpate_loop_options>(),
            try_every_size::<palpate_loop_state>(),
        ];
        // `tried` must name every struct of the header whose size the caller sets. In the header, the comment on the
        // field `size` of these structs contains "sizeof("; in other structs the library itself writes the size.
        let header = include_str!("palpate.h");
        let sized = header.split("typedef struct ").skip(1).filter(|text| {
            let body = text.split_once('}').map_or("", |(body, _)| body);
            body.contains("sizeof(")
        });
        let mut named: Vec<&str> = sized.map(|text| text.split([' ', '{']).next().unwrap()).collect();
        let mut tried = tried.to_vec();
        named.sort_unstable();
        tried.sort_unstable();
        assert_eq!(named, tried);
    }

    #[test]
    fn what_a_newer_program_sets_is_refused_and_its_zeros_are_not() {
        let mut given = [16u32, 5, 6, 0];
        let pointer = (&raw const given).cast::<Grown>();
        // SAFETY (both reads): the size field states sixteen bytes, and the array has sixteen.
        assert_eq!(unsafe { read(pointer) }.unwrap(), Grown { size: 16, old: 5, new: 6 });
        given[3] = 1;
        let pointer = (&raw const given).cast::<Grown>();
        assert!(unsafe { read(pointer) }.unwrap_err().message.contains("does not know"));
    }

    #[test]
    fn arrays_of_structs_go_by_the_size_that_the_first_says() {
        let old = [8u32, 5, 8, 6, 8, 7];
        let pointer = (&raw const old).cast::<Grown>();
        // SAFETY (all in this test): wherever the library reads structs, there are as many bytes as count and size
        // state.
        let all = unsafe { structs(pointer, 3, "all") }.unwrap();
        assert_eq!(all, [5, 6, 7].map(|old| Grown { size: 8, old, new: 2 }));
        let mixed = [8u32, 5, 12, 6, 1];
        let pointer = (&raw const mixed).cast::<Grown>();
        let message = |count| unsafe { structs(pointer, count, "all") }.unwrap_err().message;
        assert!(message(2).contains("all[1].size is not that of the first"), "{}", message(2));
        assert!(message(usize::MAX / 4).contains("more than fit into memory"));
        assert!(unsafe { structs::<Grown>(std::ptr::null(), 0, "all") }.unwrap().is_empty());
        assert_eq!(unsafe { structs::<Grown>(std::ptr::null(), 1, "all") }.unwrap_err().status, palpate_status::Null);
    }

    #[test]
    fn arrays_that_cannot_be_are_told_and_not_looked_at() {
        let numbers = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        // SAFETY (all in this test): wherever the library reads elements, there are as many as the count states.
        let rows = |count| unsafe { rows::<f64, 3>(numbers.as_ptr(), count, "rows") };
        assert_eq!(rows(2).unwrap(), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert!(rows(0).unwrap().is_empty());
        for count in [usize::MAX, usize::MAX / 24 + 1, isize::MAX as usize / 24 + 1] {
            assert!(rows(count).unwrap_err().message.contains("more than fit into memory"));
        }
        let odd = numbers.as_ptr().wrapping_byte_add(4);
        assert!(unsafe { array(odd, 1, "odd") }.unwrap_err().message.contains("odd is not aligned"));
        assert_eq!(unsafe { array::<u8>(std::ptr::null(), 1, "no") }.unwrap_err().status, palpate_status::Null);
    }
}
