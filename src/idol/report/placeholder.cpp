// Placeholder: removed with the folder's first source file.
