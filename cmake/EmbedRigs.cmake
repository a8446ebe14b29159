# idol_embed_rigs(TARGET): puts configs/rig_*.yaml into the target, to be had by name. As a script (cmake -P) it writes
# that source.

if(CMAKE_SCRIPT_MODE_FILE)
  set(rigs "")
  file(GLOB files ${CONFIG_DIR}/rig_*.yaml)
  foreach(file IN LISTS files)
    string(REGEX REPLACE ".*/rig_(.*)\\.yaml" "\\1" name ${file})
    file(READ ${file} text)
    string(APPEND rigs "    {\"${name}\", R\"idol_rig(${text})idol_rig\"},\n")
  endforeach()
  file(WRITE ${OUTPUT} "#include \"idol/base/ready_rigs.hpp\"\n\nnamespace idol {\n\n"
    "std::span<const ReadyRig> ready_rigs() {\n  static constexpr ReadyRig kRigs[] = {\n${rigs}  };\n"
    "  return kRigs;\n}\n\n}  // namespace idol\n")
  return()
endif()

set(IDOL_EMBED_RIGS_SCRIPT ${CMAKE_CURRENT_LIST_FILE})
function(idol_embed_rigs target)
  set(output ${PROJECT_BINARY_DIR}/ready_rigs.cpp)
  file(GLOB rigs CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/configs/rig_*.yaml)
  add_custom_command(OUTPUT ${output}
    COMMAND ${CMAKE_COMMAND} -DCONFIG_DIR=${PROJECT_SOURCE_DIR}/configs -DOUTPUT=${output} -P ${IDOL_EMBED_RIGS_SCRIPT}
    DEPENDS ${rigs} ${IDOL_EMBED_RIGS_SCRIPT} VERBATIM)
  target_sources(${target} PRIVATE ${output})
endfunction()
