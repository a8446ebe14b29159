#include "idol/report/report.hpp"

#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>

#include "idol/io/text_writer.hpp"
#include "idol/report/page_data.hpp"
#include "idol/report/page_json.hpp"
#include "idol/report/run_folder.hpp"

namespace idol {

/// The page without data; put into the program at build time from web/.
std::string_view empty_page();

std::string page_with(std::string_view source, std::string_view run_json, std::string_view events_base64) {
  std::string page(empty_page());
  for (const auto& [mark, text] :
       {std::pair<std::string_view, std::string_view>{"@IDOL_PAGE_SOURCE@", source},
        {"@IDOL_RUN_DATA@", run_json},
        {"@IDOL_RUN_EVENTS@", events_base64}})
    page.replace(page.find(mark), mark.size(), text);
  return page;
}

void write_report(const std::filesystem::path& run_dir) {
  const PageData data = page_data(read_run_folder(run_dir));
  write_text_file(run_dir / "report.html", page_with(R"({"kind":"report"})", data.json, base64(data.events)));
}

}  // namespace idol
