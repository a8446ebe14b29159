# idol_embed_page(TARGET): puts the page that is built from web/ into the target as one string. The built page lies in
# the source tree (web/dist); with IDOL_BUILD_PAGE npm builds it anew. As a script (cmake -P) this writes that source.

if(CMAKE_SCRIPT_MODE_FILE)
  file(READ ${PAGE} page)
  # GCC takes string literals of any length.
  file(WRITE ${OUTPUT} "#include <string_view>\n\nnamespace idol {\n\n"
    "std::string_view empty_page();\nstd::string_view empty_page() { return R\"idol_page(${page})idol_page\"; }\n\n"
    "}  // namespace idol\n")
  return()
endif()

option(IDOL_BUILD_PAGE "Build the report's page from web/ with npm, instead of taking web/dist as it is" OFF)
set(IDOL_EMBED_PAGE_SCRIPT ${CMAKE_CURRENT_LIST_FILE})

function(idol_embed_page target)
  set(web ${PROJECT_SOURCE_DIR}/web)
  set(page ${web}/dist/report.html)
  set(output ${PROJECT_BINARY_DIR}/report_page.cpp)
  if(IDOL_BUILD_PAGE)
    find_program(IDOL_NPM npm REQUIRED)
    file(GLOB sources CONFIGURE_DEPENDS ${web}/src/* ${web}/*.json ${web}/*.mjs)
    set(page ${PROJECT_BINARY_DIR}/web/report.html)
    add_custom_command(OUTPUT ${page} WORKING_DIRECTORY ${web} DEPENDS ${sources} VERBATIM
      COMMAND ${IDOL_NPM} ci --no-audit --no-fund
      COMMAND ${IDOL_NPM} run build -- --out ${page})
  endif()
  add_custom_command(OUTPUT ${output} DEPENDS ${page} ${IDOL_EMBED_PAGE_SCRIPT} VERBATIM
    COMMAND ${CMAKE_COMMAND} -DPAGE=${page} -DOUTPUT=${output} -P ${IDOL_EMBED_PAGE_SCRIPT})
  target_sources(${target} PRIVATE ${output})
endfunction()
