#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include "shared/arrays.glsl"
#include "shared/types.glsl"

// Contact stage of a step: if more candidates collide than there is room for (CAPACITY), lists the deepest of them, in
// the order of candidates. A candidate is the result of contact/candidates for one skin vertex of an active chunk (a
// group of at most 64 skin vertices that passed culling). There is one workgroup; each of its lanes handles a
// contiguous range of candidates. The test compares with a list filtered on the CPU.

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint SIZE = 8;
layout(constant_id = 1) const uint CAPACITY = 1;
layout(constant_id = 2) const uint SLOTS = CHUNK_VERTICES;  // places for candidates of an active chunk

READ_ONLY(vec4, candidate_hits);       // depth in x, m; SLOTS candidates for each active chunk
layout(scalar) readonly buffer CountsIn { Counts counts; };
layout(scalar) writeonly buffer ContactSource { uint contact_source[]; };  // candidate of each contact
layout(scalar) readonly buffer ChunkContacts { uint chunk_contacts[]; };   // a bit for each candidate: it collides

// Number of candidates that one round of a loop tests: Mesa's llvmpipe ends all loops of an invocation after 65,535
// rounds.
const uint BATCH = 16;
const uint DIGITS = 256;      // number of values of a digit of eight bits

shared uint totals[SIZE];
shared uint histogram[DIGITS];

uint begin, end;

// Depth of a candidate, m; 0 where it does not collide.
float depth_of(uint i) {
    return (chunk_contacts[i / 32] & 1u << i % 32) != 0 ? fetch(candidate_hits, i).x : 0.0;
}

uint deeper(uint i, float least) {
    return uint(depth_of(i) > least) + uint(depth_of(i + 1) > least) + uint(depth_of(i + 2) > least)
        + uint(depth_of(i + 3) > least);
}

// Number of candidates deeper than `least`, before this lane's range (x) and in total (y).
uvec2 count_deeper(float least) {
    uint lane = gl_LocalInvocationID.x;
    uint found = 0;
    for (uint i = begin; i < end; i += BATCH) {
        found += deeper(i, least) + deeper(i + 4, least) + deeper(i + 8, least) + deeper(i + 12, least);
    }
    barrier();
    totals[lane] = found;
    barrier();
    uvec2 sums = uvec2(0);
    for (uint k = 0; k < SIZE; k++) sums += uvec2(k < lane ? totals[k] : 0, totals[k]);
    return sums;
}

// Counts candidate i in the histogram of the digit of its depth's bits that begins at bit `shift`, if all higher digits
// equal those of `prefix`.
void count_digit(uint i, uint prefix, uint shift) {
    uint bits = floatBitsToUint(depth_of(i));
    if (bits != 0 && ((bits ^ prefix) >> shift >> 8) == 0) atomicAdd(histogram[bits >> shift & (DIGITS - 1)], 1);
}

void count_digits(uint i, uint prefix, uint shift) {
    count_digit(i, prefix, shift);
    count_digit(i + 1, prefix, shift);
    count_digit(i + 2, prefix, shift);
    count_digit(i + 3, prefix, shift);
}

// The greatest depth for which there is no room for all candidates that are at least as deep, found digit by digit of
// its bits, as in a radix sort.
float first_beyond_capacity() {
    uint lane = gl_LocalInvocationID.x;
    uint prefix = 0, above = 0;
    for (int shift = 24; shift >= 0; shift -= 8) {
        for (uint k = lane; k < DIGITS; k += SIZE) histogram[k] = 0;
        barrier();
        for (uint i = begin; i < end; i += BATCH) {
            count_digits(i, prefix, shift);
            count_digits(i + 4, prefix, shift);
            count_digits(i + 8, prefix, shift);
            count_digits(i + 12, prefix, shift);
        }
        barrier();
        uint digit = DIGITS - 1;
        while (digit > 0 && above + histogram[digit] <= CAPACITY) above += histogram[digit--];
        prefix |= digit << shift;
        barrier();
    }
    return uintBitsToFloat(prefix);
}

uint equal(uint i, float least) {
    return uint(depth_of(i) == least) + uint(depth_of(i + 1) == least) + uint(depth_of(i + 2) == least)
        + uint(depth_of(i + 3) == least);
}

// Number of candidates exactly as deep as `least` before this lane's range.
uint count_equal(float least) {
    uint lane = gl_LocalInvocationID.x;
    uint found = 0;
    for (uint i = begin; i < end; i += BATCH) {
        found += equal(i, least) + equal(i + 4, least) + equal(i + 8, least) + equal(i + 12, least);
    }
    barrier();
    totals[lane] = found;
    barrier();
    uint before = 0;
    for (uint k = 0; k < lane; k++) before += totals[k];
    return before;
}

// Lists candidate i if it is deeper than `least`, or if it is as deep as `least` and fewer than `room` candidates
// before it are. `ties` counts the candidates that are as deep as `least`.
void list_one(inout uint at, inout uint ties, uint i, float least, uint room) {
    float depth = depth_of(i);
    if (depth > least || (depth == least && ties < room)) contact_source[at++] = i;
    if (depth == least) ties++;
}

void list(inout uint at, inout uint ties, uint i, float least, uint room) {
    list_one(at, ties, i, least, room);
    list_one(at, ties, i + 1, least, room);
    list_one(at, ties, i + 2, least, room);
    list_one(at, ties, i + 3, least, room);
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint candidates = counts.gathering * SLOTS;
    uint run = (candidates / BATCH + SIZE - 1) / SIZE * BATCH;
    begin = min(lane * run, candidates);
    end = min(begin + run, candidates);
    float least = first_beyond_capacity();
    uvec2 sums = count_deeper(least);
    uint room = CAPACITY - sums.y, ties = count_equal(least);
    uint at = sums.x + min(ties, room);
    for (uint i = begin; i < end; i += BATCH) {
        list(at, ties, i, least, room);
        list(at, ties, i + 4, least, room);
        list(at, ties, i + 8, least, room);
        list(at, ties, i + 12, least, room);
    }
}
