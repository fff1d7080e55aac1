// The elementary functions of the page by their C names, for a native program that is started with
// this library before its own (LD_PRELOAD). The others have these names already.

double same_sin(double), same_cos(double), same_tan(double), same_exp(double);

double sin(double value) { return same_sin(value); }
double cos(double value) { return same_cos(value); }
double tan(double value) { return same_tan(value); }
double exp(double value) { return same_exp(value); }

// Compilers join a sine and a cosine of one angle.
void sincos(double value, double *sine, double *cosine) {
  *sine = same_sin(value);
  *cosine = same_cos(value);
}
