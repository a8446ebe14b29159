# What the libraries link to. Read twice: when idol is built, and by idolConfig.cmake where idol is static and
# whoever links it needs all of this too.

set(IDOL_PACKAGES Threads "Eigen3 3.4" "Ceres 2.1" LAPACK yaml-cpp fmt ZLIB PNG BZip2 PkgConfig)

# idol_find_libraries(): those without CMake files of their own, as PkgConfig::IDOL_... and idol::lzf. The names
# keep out of the way of other projects' pkg_check_modules.
macro(idol_find_libraries)
  pkg_check_modules(IDOL_ZSTD REQUIRED IMPORTED_TARGET libzstd)
  pkg_check_modules(IDOL_LZ4 REQUIRED IMPORTED_TARGET liblz4)
  pkg_check_modules(IDOL_BLOSC REQUIRED IMPORTED_TARGET blosc)
  pkg_check_modules(IDOL_CAIRO REQUIRED IMPORTED_TARGET cairo)
  pkg_check_modules(IDOL_HTTPLIB REQUIRED IMPORTED_TARGET cpp-httplib)
  pkg_search_module(IDOL_HDF5 REQUIRED IMPORTED_TARGET hdf5-serial hdf5)
  find_library(IDOL_LZF_LIBRARY lzf REQUIRED)
  find_path(IDOL_LZF_INCLUDE_DIR lzf.h PATH_SUFFIXES liblzf REQUIRED)
  if(NOT TARGET idol::lzf)
    add_library(idol::lzf UNKNOWN IMPORTED)
    set_target_properties(idol::lzf PROPERTIES IMPORTED_LOCATION ${IDOL_LZF_LIBRARY}
      INTERFACE_INCLUDE_DIRECTORIES ${IDOL_LZF_INCLUDE_DIR})
  endif()
endmacro()
