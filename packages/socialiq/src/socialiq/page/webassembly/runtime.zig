//! What the compiled core calls besides itself: memory for its arrays, and elementary functions.

const std = @import("std");

comptime {
    _ = @import("elementary.zig");
}

const alignment = 64;
const header = 64; // bytes before an array: the record that Numba's compiled code reads
const heap_size = 8 << 20;

var heap: [heap_size]u8 align(alignment) = undefined;
var kept: usize = 0; // bytes of arrays that the page reads and writes
var used: usize = 0; // bytes in use, the arrays of a running call after the kept ones
var live: usize = 0; // arrays of the running call

fn taken(bytes: usize) [*]u8 {
    const first = used;
    used += std.mem.alignForward(usize, bytes, alignment);
    if (used > heap_size) @trap();
    return heap[first..].ptr;
}

/// Return memory for an array of the page, which is never given back.
export fn allocate(bytes: usize) [*]u8 {
    const place = taken(bytes);
    kept = used;
    return place;
}

/// Numba's record of an array.
const MemInfo = extern struct {
    references: u64,
    destructor: ?*anyopaque,
    argument: ?*anyopaque,
    data: [*]u8,
    size: u64,
};

export fn NRT_MemInfo_alloc_aligned(bytes: u64, _: u32) *MemInfo {
    const size: usize = @intCast(bytes);
    const place = taken(header + size);
    const info: *MemInfo = @ptrCast(@alignCast(place));
    info.* = .{ .references = 1, .destructor = null, .argument = null, .data = place + header, .size = bytes };
    live += 1;
    return info;
}

/// Called when no reference is left: the memory is used again once no array of the call is.
export fn NRT_MemInfo_call_dtor(_: *MemInfo) void {
    live -= 1;
    if (live == 0) used = kept;
}
