// What lookups take, for the AOVs that tell of it: nothing is compiled otherwise.
// Defines: LOOKUP_COUNTS 1 where it is asked for.
// Provides LOOKUP_COUNT, LOOKUP_FILTER; then also lookupFetches, lookupFilter.
#ifndef LOOKUP_COUNTS
#define LOOKUP_COUNTS 0
#endif
#if LOOKUP_COUNTS
float lookupFetches = 0.0;      // texels; a bilinear access takes 4
float lookupFilter = -1.0;      // place in FILTERS of fexel/filters/__init__.py
#define LOOKUP_COUNT(texels) lookupFetches += float(texels)
#define LOOKUP_FILTER(code) lookupFilter = float(code)
#else
#define LOOKUP_COUNT(texels)
#define LOOKUP_FILTER(code)
#endif
