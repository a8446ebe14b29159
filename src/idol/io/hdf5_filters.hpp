// Compression of HDF5 files that the library knows only with plug-ins.
#pragma once

#include <cstddef>

namespace idol {

/// Makes Blosc and LZF known to the library, for reading. May be called again.
void register_hdf5_filters();

/// A chunk that this thread reads from now on decodes to so many bytes, or is refused.
void expect_hdf5_chunk(std::size_t bytes);

}  // namespace idol
