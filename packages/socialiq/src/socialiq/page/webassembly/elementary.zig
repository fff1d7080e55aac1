//! Elementary functions that the compiled core calls, by their C names.
//!
//! The power is musl's (pow.c beside this file in the build); sine, cosine, tangent and exponential
//! come with the compiler. `same_*` makes these visible outside a shared library (names.c), so that
//! both sides of a comparison can call the same functions.

const std = @import("std");

extern fn sin(f64) f64;
extern fn cos(f64) f64;
extern fn tan(f64) f64;
extern fn exp(f64) f64;

export fn asin(value: f64) f64 {
    return std.math.asin(value);
}

export fn atan(value: f64) f64 {
    return std.math.atan(value);
}

export fn atan2(y: f64, x: f64) f64 {
    return std.math.atan2(y, x);
}

export fn log1p(value: f64) f64 {
    return std.math.log1p(value);
}

export fn same_sin(value: f64) f64 {
    return sin(value);
}

export fn same_cos(value: f64) f64 {
    return cos(value);
}

export fn same_tan(value: f64) f64 {
    return tan(value);
}

export fn same_exp(value: f64) f64 {
    return exp(value);
}
