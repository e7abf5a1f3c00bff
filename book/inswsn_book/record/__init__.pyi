from .chapter import ChapterRecord as ChapterRecord
