// Compression of HDF5 files that the library knows only with plug-ins.
#pragma once

namespace idol {

/// Makes Blosc and LZF known to the library, for reading. May be called again.
void register_hdf5_filters();

}  // namespace idol
