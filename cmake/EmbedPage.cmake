# idol_embed_page(TARGET): puts src/idol/report/page into the target as one string, style and scripts in
# place. As a script (cmake -P) it writes that source; so the page is rebuilt whenever one of its files changes.

function(idol_write_page_source page_dir output)
  file(READ ${page_dir}/index.html page)
  foreach(part IN ITEMS style.css view3d.js charts.js tables.js main.js)
    file(READ ${page_dir}/${part} text)
    string(REPLACE "@${part}@" "${text}" page "${page}")
  endforeach()
  file(WRITE ${output} "#include <string_view>\n\nnamespace idol {\n\n"
    "std::string_view report_page();\nstd::string_view report_page() { return R\"idol_page(${page})idol_page\"; }\n\n"
    "}  // namespace idol\n")
endfunction()

if(CMAKE_SCRIPT_MODE_FILE)
  idol_write_page_source(${PAGE_DIR} ${OUTPUT})
  return()
endif()

set(IDOL_EMBED_PAGE_SCRIPT ${CMAKE_CURRENT_LIST_FILE})
function(idol_embed_page target)
  set(page_dir ${PROJECT_SOURCE_DIR}/src/idol/report/page)
  set(output ${PROJECT_BINARY_DIR}/report_page.cpp)
  file(GLOB parts CONFIGURE_DEPENDS ${page_dir}/*)
  add_custom_command(OUTPUT ${output}
    COMMAND ${CMAKE_COMMAND} -DPAGE_DIR=${page_dir} -DOUTPUT=${output} -P ${IDOL_EMBED_PAGE_SCRIPT}
    DEPENDS ${parts} ${IDOL_EMBED_PAGE_SCRIPT} VERBATIM)
  target_sources(${target} PRIVATE ${output})
endfunction()
