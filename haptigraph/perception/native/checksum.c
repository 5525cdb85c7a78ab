/* Which sources the library was compiled from: library.py refuses one that does not fit those beside it. */

#include "native.h"

#ifndef SOURCES
#error "compile with: python hatch_build.py"
#endif

EXPORT const uint32_t sources = SOURCES;
